"""A recording: the steps of a session in memory, and how they become motion files and a scene.

RUN/recordings/hand_001_MODEL.h5 and .xdmf    a motion, as `softprint simulate` writes it
RUN/recordings/hand_001_MODEL.gif             a short film of it, if it is wanted (`processes/writing_process.py`)
RUN/recordings/hand_001.toml                  the scene: paste it into the experiment file
"""

from __future__ import annotations

from collections.abc import Callable, Container, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from softprint.runtime.colliders import RigidPose
from softprint.runtime.colliders.kinds.table import ColliderTable
from softprint.runtime.colliders.surface_points import surface_points
from softprint.runtime.contact.intrusion import intrusion
from softprint.runtime.dynamics.state import ReducedState, StepResult
from softprint.runtime.experiment.sources import with_absolute_paths
from softprint.runtime.io.files import atomic_path, content_hash
from softprint.runtime.scenes.motion_colliders import tables_as_json
from softprint.runtime.scenes.motion_file import MotionHeader, write_motion
from softprint.runtime.viewer.session.scene_text import keyframe_tables, scene_text
from softprint.runtime.viewer.session.workshop import Model, Workshop

FOLDER = "recordings"
# Keyframes follow the recorded path to this share of the body's size.
_TOLERANCE = 2e-4


@dataclass(frozen=True, eq=False)
class Frame:
    """One step of all models; handles: the displacements of those that are led; pulled: whether a spring pulls."""

    results: tuple[StepResult[ReducedState], ...]
    handles: Mapping[int | str, RigidPose]
    pulled: bool


@dataclass
class Recording:
    """The frames so far of these models, with these colliders, of which some move freely with a density; film: whether
    a GIF of each motion is wanted, too."""

    models: tuple[Model, ...]
    tables: tuple[ColliderTable, ...]
    free: Mapping[str, float]
    film: bool = False
    frames: list[Frame] = field(default_factory=list)

    @property
    def seconds(self) -> float:
        """Its length in simulated time."""
        if not self.frames:
            return 0.0
        first, last = self.frames[0].results[0], self.frames[-1].results[0]
        return last.state.time - first.state.time

    def add(
        self,
        results: tuple[StepResult[ReducedState], ...],
        handles: Mapping[int | str, RigidPose],
        pulled: bool,
    ) -> None:
        """Append a step, without what only the step after it needed."""
        lean = tuple(
            replace(result, state=replace(result.state, factorisation=None, elastic_hessian=None))
            for result in results
        )
        self.frames.append(Frame(lean, dict(handles), pulled))

    def write(
        self, workshop: Workshop, folder: Path, name: str, progress: Callable[[int], None] = lambda n: None
    ) -> list[Path]:
        """Write the motions and the scene under a name; returns the paths, the scene's last. progress(1) is called
        after each frame of each motion."""
        scene = self._scene(workshop, name)
        known = {table.name: table.model_dump_json() for table in workshop.experiment.colliders}
        new = [
            with_absolute_paths(table, workshop.experiment.base_dir)
            for table in self.tables
            if table.name not in workshop.experiment.collider_names
            or known.get(table.name, "") not in ("", table.model_dump_json())
        ]
        text = scene_text(scene, new, self._remarks(workshop, name))
        paths = []
        for number, model in enumerate(self.models):
            path = folder / f"{name}_{model.name}.h5"
            self._write_motion(path, number, model, workshop, name, text, progress)
            paths.append(path)
        path = folder / f"{name}.toml"
        with atomic_path(path) as temporary:
            temporary.write_text(text, encoding="utf-8")
        return [*paths, path]

    def _write_motion(
        self,
        path: Path,
        number: int,
        model: Model,
        workshop: Workshop,
        name: str,
        text: str,
        progress: Callable[[int], None],
    ) -> None:
        body = workshop.body
        results = [frame.results[number] for frame in self.frames]
        surfaces = {placed.name: surface_points(placed.collider) for placed in model.simulator.colliders}
        rows = np.array([result.state.rows for result in results])
        digest = content_hash({"recorded": name, "body": body.content_hash, "rows": rows})
        tables = tables_as_json(self.tables, workshop.experiment.base_dir)
        header = MotionHeader(model.name, name, digest, f"{workshop.experiment.text}\n{text}", tables)
        begin = results[0].state.time
        with write_motion(path, header, body, len(results)) as writer:
            for result in results:
                x = model.simulator.positions(result.state)
                intrusions = {
                    own: intrusion(result.state.poses[own].apply(points), body.mesh, x).depth
                    for own, points in surfaces.items()
                }
                shifted = replace(result.state, time=result.state.time - begin)
                writer.add(replace(result, state=shifted), shifted.rows, x, intrusions)
                progress(1)

    def _scene(self, workshop: Workshop, name: str) -> dict[str, Any]:
        """The scene of the first model."""
        states = [frame.results[0].state for frame in self.frames]
        times = np.array([state.time for state in states]) - states[0].time
        distance = _TOLERANCE * workshop.body.mesh.size
        step = workshop.parts.settings.time_step
        scene: dict[str, Any] = {
            "name": name,
            "role": "record",
            "duration": round(max(float(times[-1]), step), 6),
            "kinematic": self._kinematic(workshop, times, distance),
        }
        if workshop.scene.springs:
            scene["springs"] = [
                spring.model_dump(mode="json", exclude_none=True) for spring in workshop.scene.springs
            ]
        if workshop.scene.tracking is not None:
            scene["tracking"] = workshop.scene.tracking.model_dump(mode="json", exclude_none=True)
        scene["colliders"] = [
            self._free_table(table.name, states[0])
            if table.name in self.free
            else {
                "name": table.name,
                "keyframes": keyframe_tables(times, [state.poses[table.name] for state in states], distance),
            }
            for table in self.tables
        ]
        return scene

    def _free_table(self, name: str, state: ReducedState) -> dict[str, Any]:
        placed = next(own for own in self.models[0].simulator.colliders if own.name == name)
        assert placed.free is not None
        pose, motion = state.poses[name], state.motions[name]
        return {
            "name": name,
            "density": self.free[name],
            "position": pose.translation.tolist(),
            "rotation": pose.rotation_vector.tolist(),
            "velocity": motion.velocity.tolist(),
            "spin": motion.spin(placed.free.mass, pose).tolist(),
        }

    def _kinematic(self, workshop: Workshop, times: Any, distance: float) -> list[Any]:
        """The handles of the scene that are held, and those that were led, with their keyframes."""
        led = dict.fromkeys(handle for frame in self.frames for handle in frame.handles)
        still = RigidPose.identity(workshop.body.dim)
        entries: list[Any] = [
            entry if isinstance(entry, int | str) else entry.model_dump(mode="json", exclude_none=True)
            for entry in workshop.scene.kinematic
            if (entry if isinstance(entry, int | str) else entry.handle) not in led
        ]
        for handle in led:
            poses = [frame.handles.get(handle, still) for frame in self.frames]
            tables = keyframe_tables(times, poses, distance)
            if not isinstance(handle, str):  # a point has no rotation
                tables = [{key: own[key] for key in ("time", "position")} for own in tables]
            entries.append({"handle": handle, "keyframes": tables})
        return entries

    def _remarks(self, workshop: Workshop, name: str) -> list[str]:
        remarks = [
            f"{name}: a press by hand, recorded by `softprint view` with {', '.join(m.name for m in self.models)}.",
            f"To use it, append this file to the experiment ({workshop.experiment.path.name}); role = "
            '"test" holds it out of training.',
        ]
        if any(contact.points for contact in self.frames[0].results[0].contacts.values()):
            remarks.append(
                "The recording begins in contact, but a scene begins at rest: the first steps will differ."
            )
        if any(frame.pulled for frame in self.frames):
            remarks.append("The body was also pulled by a spring on a point, which is not in the scene.")
        return remarks


def free_name(folder: Path, used: Container[str] = ()) -> str:
    """The first of hand_001, hand_002, ... that no file of the folder begins with, and that is not used."""
    taken = {path.name[: len("hand_000")] for path in folder.glob("hand_*")}
    number = 1
    while (name := f"hand_{number:03d}") in taken or name in used:
        number += 1
    return name
