"""Motions of shapes with thin limbs and sharp edges: pressed into the top of a body and dragged sideways.

    python -m benchmarks.thin_shapes examples/jelly_library_small.toml [--out RUN] [--shapes fork ...] [--set KEY=VALUE]

Every shape is of 20 to 50 mm, with limbs of 2 to 4 mm; two meshes come with PyVista, and are rebuilt. Each is played in
full space, with the bare subspace, with linear mechanics, and with corrections of the run for any collider
(`--models`), each model alone. In the frames in which full space is in contact:

    off = sqrt(mean |x - x_full|^2) over all nodes and frames, as a share of that of the bare subspace
    force = sqrt(mean |f - f_full|^2) / sqrt(mean |f_full|^2)

Pierced: the frames in which the collider's surface is deeper inside the deformed body than the distance between surface
nodes, found in all cells without the contact law (`runtime/contact/intrusion.py`); deepest: of all frames.
"""

from __future__ import annotations

import argparse
import logging
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyvista

from softprint.fem_truth.dynamics.full_space_simulator import FullSpaceSimulator
from softprint.fem_truth.report.drawing.panels import save_panels
from softprint.fem_truth.report.drawing.picture import Picture
from softprint.fem_truth.report.drawing.renderings import make_renderer
from softprint.runtime.arrays import Array
from softprint.runtime.body import ReducedBody, load_body
from softprint.runtime.cli.script import run_script
from softprint.runtime.colliders import Collider, KeyframedPath, RigidPose, mesh_collider
from softprint.runtime.colliders.library import zero_level
from softprint.runtime.colliders.pose import rotation_matrix
from softprint.runtime.colliders.sampled.grid import GridCollider
from softprint.runtime.colliders.surface_mesh.mesh_collider import read_surface
from softprint.runtime.colliders.surface_mesh.rebuild import rebuilt_surface
from softprint.runtime.colliders.surface_points import surface_points
from softprint.runtime.contact import PenaltyContact
from softprint.runtime.contact.intrusion import intrusion, pierced_from
from softprint.runtime.dynamics import DynamicsSettings, KinematicHandle, PlacedCollider, Simulator
from softprint.runtime.errors import SoftprintError
from softprint.runtime.experiment import Experiment, load_experiment
from softprint.runtime.experiment.schema.training import ModelSpec
from softprint.runtime.learned.correction import Correction, mechanics_of
from softprint.runtime.learned.correction_file import load_correction
from softprint.runtime.learned.force.correction import ForceCorrection
from softprint.runtime.learned.force.entry import options
from softprint.runtime.learned.force.model import ForceModel
from softprint.runtime.mechanics.body_mechanics import BodyMechanics
from softprint.runtime.mechanics.mechanics_file import load_mechanics, mechanics_path
from softprint.runtime.optimise import NewtonSettings
from softprint.runtime.shapes.shape import Shape
from softprint.runtime.shapes.solid import Field, box, capsule, torus, tube, union

CONTACT_NODES = 3000
RESOLUTION = 96  # cells along the longest side: less than half a millimetre
# Of the judge: where an edge slides over the surface, each corner of a facet that it crosses takes some iterations.
_JUDGE_ITERATIONS = 100
SCANNED = 0.025  # m, half of the longest side
CLEAR, DRAG = 0.003, 0.02  # m, above the body at first; sideways
TIMES = (0.0, 0.3, 0.4, 1.2)  # s: begins, is down, is dragged, ends


def _row(count: int, apart: float, one: Callable[[float], Field]) -> list[Field]:
    """Some equal parts in a row along y; one: makes that at y."""
    return [one(apart * (k - 0.5 * (count - 1))) for k in range(count)]


def _fork() -> Field:
    tines = _row(4, 0.005, lambda y: capsule([0, y, -0.02], [0, y, 0], 0.0012))
    return union(*tines, box([0.0015, 0.0095, 0.0015]), capsule([0, 0, 0], [0, 0, 0.02], 0.002))


def _comb() -> Field:
    teeth = _row(9, 0.004, lambda y: capsule([0, y, -0.01], [0, y, 0], 0.001))
    return union(*teeth, lambda p: box([0.0015, 0.018, 0.003])(p - [0, 0, 0.002]))


def _chair() -> Field:
    legs = [capsule([x, y, -0.018], [x, y, 0], 0.0015) for x in (-0.011, 0.011) for y in (-0.011, 0.011)]
    back = [capsule([-0.011, y, 0], [-0.013, y, 0.022], 0.0015) for y in (-0.011, 0.011)]
    rail = capsule([-0.013, -0.011, 0.02], [-0.013, 0.011, 0.02], 0.0015)
    return union(*legs, *back, rail, box([0.0125, 0.0125, 0.0015], 0.0005))


def _rake() -> Field:
    def finger(y: float) -> Field:
        knuckle = [0.004, y, -0.006]
        return union(
            capsule([0, 0.6 * y, 0.004], knuckle, 0.002), capsule(knuckle, [0, 1.2 * y, -0.018], 0.0015)
        )

    return union(*_row(5, 0.007, finger), box([0.003, 0.011, 0.004], 0.001))


def _helix() -> Field:
    t = np.linspace(0.0, 8.0 * np.pi, 2000)
    return tube(
        np.column_stack([0.008 * np.cos(t), 0.006 * t / (2.0 * np.pi) - 0.012, 0.008 * np.sin(t)]), 0.0012
    )


FIELDS: Mapping[str, tuple[Callable[[], Field], tuple[float, float, float]]] = {
    "fork": (_fork, (0.004, 0.012, 0.024)),
    "comb": (_comb, (0.004, 0.02, 0.012)),
    "chair": (_chair, (0.017, 0.015, 0.026)),
    "rake": (_rake, (0.009, 0.021, 0.022)),
    "ring": (lambda: lambda p: torus(0.012, 0.0015)(p[:, [1, 2, 0]]), (0.003, 0.015, 0.015)),
    "helix": (_helix, (0.011, 0.015, 0.011)),
    "plate, edge-on": (lambda: box([0.012, 0.001, 0.008], 0.0003), (0.014, 0.002, 0.01)),
    "plate, across": (lambda: box([0.001, 0.012, 0.008], 0.0003), (0.002, 0.014, 0.01)),
    "plate, flat": (lambda: box([0.012, 0.008, 0.001], 0.0003), (0.014, 0.01, 0.002)),
    "needle": (lambda: capsule([0, 0, -0.009], [0, 0, 0.009], 0.0003, 0.003), (0.004, 0.004, 0.013)),
    "cone": (lambda: capsule([0, 0, -0.008], [0, 0, 0.006], 0.0005, 0.009), (0.011, 0.011, 0.017)),
}
SCANS: Mapping[str, str] = {"ant": pyvista.examples.antfile, "airplane": pyvista.examples.planefile}
SHAPES = [*FIELDS, *SCANS]


def shape_of(name: str) -> Collider:
    """A shape of the table."""
    if name in SCANS:
        vertices, faces, _, _ = rebuilt_surface(*read_surface(Path(SCANS[name])), name)
        lower, upper = vertices.min(axis=0), vertices.max(axis=0)
        scale = 2.0 * SCANNED / float((upper - lower).max())
        return mesh_collider(scale * (vertices - 0.5 * (lower + upper)), faces, RESOLUTION, name)
    field, reach = FIELDS[name]
    solid = Shape(name.partition(",")[0], name, reach, field(), exact=True, cells=RESOLUTION)
    return GridCollider(solid.field, *zero_level(solid), RESOLUTION, name)


@dataclass(frozen=True, eq=False)
class Played:
    """Frames of one model. x: (t, n_nodes, 3) [m]; poses: of the shape (t); force: (t, 3) [N]; depth: of the collider
    in the body (t,) [m]; flagged, unconverged: steps that said PIERCED, or that did not converge otherwise."""

    x: Array
    poses: Sequence[RigidPose]
    force: Array
    depth: Array
    flagged: int
    unconverged: int


class Bench:
    """The body of a run and its mechanics."""

    def __init__(self, experiment: Experiment, run: Path, depth: float) -> None:
        self.experiment, self.run, self.depth = experiment, run, depth
        self.body: ReducedBody = load_body(run / "body.h5")
        self.mechanics: BodyMechanics = load_mechanics(mechanics_path(run, CONTACT_NODES), self.body)
        self.law = PenaltyContact.of(experiment.contact)
        self.top = float(self.body.mesh.points[:, 2].max())

    def play(self, shape: Collider, model: str, turn: float = 0.0) -> Played:
        """One motion; model: "full", "bare" or the name of a correction; turn: of shape and path about the axis that
        points up [rad]."""
        points = surface_points(shape)
        high = self.top - float(points[:, 2].min())
        heights = [high + CLEAR, high - self.depth, high - self.depth, high - self.depth]
        along = [-0.5 * DRAG, -0.5 * DRAG, -0.5 * DRAG, 0.5 * DRAG]
        way = np.array([[x, 0.003, z] for x, z in zip(along, heights, strict=True)])
        turns = np.tile([0.0, 0.0, turn], (len(TIMES), 1))
        path = KeyframedPath(TIMES, way @ about_the_axis(turn).T, turns)
        simulator: Any = self._simulator(shape, path, model)
        state = simulator.rest_state()
        x, poses, force, depth = [], [], [], []
        flagged = unconverged = 0
        for _ in range(round(TIMES[-1] / self.experiment.dynamics.time_step)):
            result = simulator.step(state)
            state, pierced = result.state, getattr(result, "piercing", None) is not None
            flagged += pierced
            unconverged += not result.converged and not pierced
            x.append(simulator.positions(state))
            poses.append(state.poses[shape.name])
            force.append(result.contacts[shape.name].force)
            around = poses[-1].apply(points)
            depth.append(intrusion(around, self.body.mesh, x[-1]).depth)
        return Played(np.array(x), poses, np.array(force), np.array(depth), flagged, unconverged)

    def _simulator(self, shape: Collider, path: KeyframedPath, model: str) -> Simulator | FullSpaceSimulator:
        own = self.experiment.dynamics
        held = [KinematicHandle(frame.name) for frame in self.body.handles.frames]
        settings = DynamicsSettings(own.time_step, NewtonSettings(own.max_iterations))
        if model == "full":
            settings = DynamicsSettings(own.time_step, NewtonSettings(_JUDGE_ITERATIONS))
            return FullSpaceSimulator(
                self.body,
                [PlacedCollider(shape.name, shape, path)],
                contact=self.law,
                gravity=own.gravity,
                kinematic=held,
                settings=settings,
            )
        correction: Correction | None = None
        mechanics = None if model == "bare" else self.mechanics
        if model == "mechanics":
            correction = self._untrained(shape)
        elif model != "bare":
            file = self.run / "corrections" / f"{model}.safetensors"
            correction = load_correction(file, self.body, shape, self.mechanics)
            mechanics = mechanics_of([correction], mechanics)
        return Simulator(
            self.body,
            [PlacedCollider(shape.name, shape, path, correction)],
            contact=self.law,
            mechanics=mechanics,
            gravity=own.gravity,
            kinematic=held,
            settings=settings,
        )

    def _untrained(self, shape: Collider) -> ForceCorrection:
        """Whose dents are those of linear mechanics."""
        law, spec = self.law, ModelSpec(name="mechanics")
        model = ForceModel(options(spec, self.body, law), self.body.dim, self.body.n_rows)
        return ForceCorrection("mechanics", model, self.body, shape, self.mechanics)


def about_the_axis(turn: float) -> Array:
    """(3, 3) the rotation by an angle [rad] about the axis that points up."""
    return rotation_matrix(np.array([0.0, 0.0, turn]), 3)


def rms(vectors: Array) -> float:
    """sqrt(mean |v|^2) of vectors (..., 3)."""
    return float(np.sqrt(np.square(vectors).sum(axis=-1).mean()))


def line(shape: str, played: Mapping[str, Played], limit: float) -> str:
    """One row of the table."""
    full, bare = played["full"], played["bare"]
    there = np.abs(full.force).sum(axis=1) > 0.0
    whole = rms(bare.x[there] - full.x[there])
    cells = [shape, f"{rms(full.force[there]):.2f}", _inside(full, limit), f"{1e3 * whole:.2f}"]
    for model, own in played.items():
        if model in ("full", "bare"):
            continue
        missed = rms(own.force[there] - full.force[there]) / rms(full.force[there])
        cells += [f"{rms(own.x[there] - full.x[there]) / whole:.0%}, {missed:.0%}", _inside(own, limit)]
    return "| " + " | ".join(cells) + " |"


def panels(
    body: ReducedBody, name: str, shape: Collider, played: Mapping[str, Played]
) -> list[tuple[str, Picture]]:
    """The models cut open through the deepest node of full space, half way along the drag."""
    full = played["full"]
    frame = round(len(full.x) * 0.5 * (TIMES[2] + TIMES[3]) / TIMES[3])
    pose, surface = full.poses[frame], body.mesh.surface_nodes
    moved = np.linalg.norm(full.x[frame] - body.mesh.points, axis=1)[surface]
    centre = full.x[frame][surface[np.argmax(moved)]]
    renderer = make_renderer(body.mesh, shape, pose)
    row = []
    for model, own in played.items():
        shot = renderer.cut(own.x[frame], pose, centre, model)
        row.append((f"{name}: {model}", shot or renderer.outside(own.x[frame], pose, model)))
    return row


def _inside(played: Played, limit: float) -> str:
    """Deepest, frames that are pierced, of these said by the step; and steps that did not converge."""
    pierced = int((played.depth > limit).sum())
    text = f"{1e3 * played.depth.max():.1f}"
    if pierced or played.flagged:
        text += f" ({pierced}; {played.flagged} said)"
    return text + (f", {played.unconverged} unconverged" if played.unconverged else "")


def main(words: Sequence[str] | None = None) -> None:
    """Prints a table in Markdown, row by row."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("experiment", type=Path)
    parser.add_argument("--out", type=Path, help="the run directory; default: runs/NAME")
    parser.add_argument("--shapes", nargs="+", default=SHAPES, choices=SHAPES, metavar="NAME")
    parser.add_argument("--models", nargs="+", default=["mechanics", "ours"], metavar="NAME")
    parser.add_argument("--depth", type=float, default=0.004, help="m, below the undeformed top")
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE", help="of the experiment")
    parser.add_argument(
        "--picture", type=Path, metavar="FILE.png", help="all shapes, cut open half way along the drag"
    )
    given = parser.parse_args(words)
    logging.getLogger("softprint").setLevel(logging.ERROR)  # what a warning says is in the table
    run = given.out or Path("runs") / given.experiment.stem
    bench = Bench(load_experiment(given.experiment, given.set), run, given.depth)
    limit = pierced_from(bench.body.mesh)
    heads = ["shape", "force, N", "full space: deepest, mm", "bare off, mm"]
    for model in given.models:
        heads += [f"{model}: off, force", f"{model}: deepest, mm"]
    print(f"pierced from {1e3 * limit:.1f} mm on\n")
    print("| " + " | ".join(heads) + " |")
    print("| --- " * len(heads) + "|", flush=True)
    drawn = []
    for name in given.shapes:
        try:
            shape = shape_of(name)
        except SoftprintError as error:
            print(f"| {name} | {error} |", flush=True)
            continue
        played = {model: bench.play(shape, model) for model in ("full", "bare", *given.models)}
        print(line(name, played, limit), flush=True)
        if given.picture:
            drawn.append(panels(bench.body, name, shape, played))
    if given.picture:
        save_panels(given.picture, drawn)


if __name__ == "__main__":
    run_script(main)
