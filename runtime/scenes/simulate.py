"""Play the scenes of an experiment and write their motions: the implementation of `softprint simulate`."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from softprint.runtime.body.body import ReducedBody
from softprint.runtime.colliders.surface_points import surface_points
from softprint.runtime.contact.intrusion import intrusion, pierced_from
from softprint.runtime.contact.penalty import CONTACT_VERSION
from softprint.runtime.errors import SoftprintError
from softprint.runtime.experiment.experiment import CONDENSED, FULL
from softprint.runtime.experiment.sources import scene_files
from softprint.runtime.io.files import content_hash, file_hash
from softprint.runtime.scenes.corrected_body import internal_path
from softprint.runtime.scenes.model_name import ModelName
from softprint.runtime.scenes.motion_colliders import collider_tables
from softprint.runtime.scenes.motion_file import (
    MotionHeader,
    motion_inputs_hash,
    side_file,
    write_motion,
    write_side_file,
)
from softprint.runtime.scenes.playing import BARE, build_model, correction_path, play
from softprint.runtime.scenes.scene import scene_steps

if TYPE_CHECKING:
    from softprint.runtime.cli.context import Context
    from softprint.runtime.experiment import Experiment, SceneSpec

log = logging.getLogger(__name__)

# Of what holds and pulls point handles in full space, their projections; and of frames that move freely there: rigid.
_POINTS_VERSION = 2
_FRAMES_VERSION = 2


@dataclass(frozen=True)
class Played:
    """One finished motion: its file, whether an earlier run made it, steps per second, steps not converged."""

    path: Path
    kept: bool
    steps_per_second: float = 0.0
    not_converged: int = 0


def motion_path(out: Path, scene: str, model: str) -> Path:
    """motions/<scene>_<model>.h5 in the run directory."""
    return out / "motions" / f"{scene}_{model}.h5"


def inputs_hash(experiment: Experiment, body: ReducedBody, scene: SceneSpec, out: Path, model: str) -> str:
    """A hash of everything that determines a motion: body, cubature, scene, colliders, all their files, dynamics, the
    correction, and its mechanics."""
    content: dict[str, object] = {
        "model": model,
        "body": body.content_hash,
        "cubature": body.cubature.weights,
        "cubature_cells": body.cubature.cells,
        "surface": body.surface.nodes,
        "scene": scene.model_dump_json(exclude_none=True),
        "contact": experiment.contact.model_dump_json(),
        "contact_version": CONTACT_VERSION,
        "dynamics": experiment.dynamics.model_dump_json(),
    }
    if model == FULL and scene.leads_points:
        content["points_version"] = _POINTS_VERSION
    if model == FULL and {frame.name for frame in body.handles.frames} - set(scene.kinematic_handles):
        content["frames_version"] = _FRAMES_VERSION
    for entry in scene.colliders:
        content[f"collider_{entry.name}"] = experiment.collider(entry.name).model_dump_json()
    content |= scene_files(experiment, scene)
    if internal_path(out, model).is_file():
        content["internal"] = file_hash(internal_path(out, model))
    name = ModelName.of(model)
    correction = correction_path(out, name.correction)
    if model != BARE and correction.is_file():
        # Imported here, because torch takes a second to load and the other models do not need it.
        from softprint.runtime.learned.correction_file import read_header

        header = read_header(correction)
        content["correction"] = file_hash(correction)
        content["mechanics"] = header.mechanics_hash
        below = name.below(header.added_to)
        if below and below != CONDENSED:
            content["internal"] = file_hash(internal_path(out, below))
    return content_hash(content)


def simulate_scene(
    context: Context, body: ReducedBody, scene: SceneSpec, model: str, experiment: Experiment | None = None
) -> Played:
    """Play one scene with one model into its motion file; with --resume, a finished motion of the same inputs is kept.
    experiment: defines the scene's colliders, that of the context by default."""
    experiment, out = experiment or context.experiment, context.out_dir
    path = motion_path(out, scene.name, model)
    digest = inputs_hash(experiment, body, scene, out, model)
    if context.resume and _is_finished(path, digest):
        return Played(path, kept=True)
    with context.stage(f"preparing {scene.name} ({model})"):
        player = build_model(experiment, body, scene, out, model)
        surfaces = {placed.name: surface_points(placed.collider) for placed in player.colliders}
    n_steps = scene_steps(experiment, scene)
    tables = collider_tables(experiment, scene)
    header = MotionHeader(model, scene.name, digest, experiment.text, tables)
    seconds, not_converged, untouched = 0.0, 0, set(surfaces)
    limit = pierced_from(body.mesh)
    pierced: list[tuple[float, str, int]] = []  # depth, collider, frame
    with (
        write_motion(path, header, body, n_steps + 1) as writer,
        context.progress(n_steps, unit="steps", desc=f"{scene.name} ({model})") as progress,
    ):
        for frame, result in enumerate(play(player, n_steps)):
            x = player.positions(result.state)
            intrusions = {
                name: intrusion(result.state.poses[name].apply(surface), body.mesh, x).depth
                for name, surface in surfaces.items()
            }
            writer.add(result, player.rows(result.state), x, intrusions)
            pierced += [(depth, name, frame) for name, depth in intrusions.items() if depth > limit]
            untouched -= {name for name, contact in result.contacts.items() if contact.points}
            if not result.converged and not frame:
                log.info("%s (%s): the start is not balanced: %s", scene.name, model, result.reason)
            elif not result.converged:
                not_converged += 1
                log.debug("%s (%s), frame %d: %s", scene.name, model, frame, result.reason)
            if frame:
                seconds += result.timings["total"]
                progress.update()
    if not_converged:
        level = logging.WARNING if not_converged == n_steps else logging.INFO
        log.log(
            level,
            "%s (%s): %d of %d steps did not converge; see `status` in %s",
            *(scene.name, model, not_converged, n_steps, path),
        )
    warn_of_contact(f"{scene.name} ({model})", n_steps + 1, pierced, untouched)
    return Played(path, False, n_steps / seconds, not_converged)


def warn_of_contact(
    motion: str, n_frames: int, pierced: Sequence[tuple[float, str, int]], untouched: set[str]
) -> None:
    """Of colliders that pierce the body, each with its depth [m] and frame, and of others that never touch it."""
    if pierced:
        depth, name, frame = max(pierced)
        frames = len({frame for *_, frame in pierced})
        log.warning(
            "%s: the body is pierced in %d of %d frames, most in frame %d: collider %r is %.1f mm inside it",
            *(motion, frames, n_frames, frame, name, 1e3 * depth),
        )
    for name in sorted(untouched - {name for _, name, _ in pierced}):
        log.warning("%s: collider %r never touches the body", motion, name)


def _is_finished(path: Path, digest: str) -> bool:
    """Whether the file contains the motion of the same inputs. A file of other inputs is replaced."""
    if not path.is_file():
        return False
    try:
        finished = motion_inputs_hash(path) == digest
    except SoftprintError as error:
        log.warning("%s; it is computed again", error)
        return False
    if finished and not side_file(path).is_file():
        write_side_file(path)
    return finished
