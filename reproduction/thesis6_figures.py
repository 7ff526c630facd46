"""Figures 6.3 to 6.7 of the thesis as numbers, and drawn on one page.

    python -m reproduction.thesis6_figures EXPERIMENT [--out RUN] [--steps 25] [--plot FILE.png]

Needs the variants that `thesis6_ablation.py` has trained, and for the plot what `descriptor_ways.py` wrote too. Prints,
as means over the seeds that were trained, with the lowest and the highest in brackets:

    jump    (6.3) for the thesis's smoothed normal and the raw gradient: a collider with holes is moved slowly, 20 um
            and 0.1 degrees a step, from contacts of the truth. Fastest: how much a surface sample's displacement
            changes at most, over the motion of the collider there [mm/mm], median over the paths and the largest.
            Flicker: RMS second difference over RMS first difference in time; jumps make it large.
    void    (6.6) a cylinder pressed flat into the body at rest, and one with a blind hole from behind that leaves a
            floor of 4 mm: sqrt(<|u_void - u_solid|^2> / <|u_solid|^2>) over the surface samples, pressed in by 1 mm and
            by 3 mm. The floor stays between the body and the hole, so all of it is error.

Linear mechanics of the body at rest, and ours, stand beside them if the run has them.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable, Sequence
from functools import partial
from itertools import pairwise
from pathlib import Path

import numpy as np

from reproduction.descriptor_ways import direct_contact, paths
from reproduction.thesis6_ablation import VARIANTS, load_variant
from softprint.runtime.arrays import Array
from softprint.runtime.body.body import ReducedBody
from softprint.runtime.cli.context import Context
from softprint.runtime.cli.run_body import body_of_run
from softprint.runtime.cli.script import run_script
from softprint.runtime.colliders import Cylinder, Placed, RigidPose, SmoothDifference
from softprint.runtime.colliders.build import build_collider
from softprint.runtime.colliders.collider import Collider
from softprint.runtime.errors import SoftprintError
from softprint.runtime.io.files import atomic_path
from softprint.runtime.learned.correction import Correction
from softprint.runtime.learned.correction_file import read_correction
from softprint.runtime.learned.static_correction import StaticCorrection
from softprint.runtime.learned.thesis6.model import DescriptorModel
from softprint.runtime.scenes.playing import correction_path
from softprint.runtime.truth.truth_file import TruthData, load_truth

# Testing shapes with holes: many points at which the nearest point of the surface changes.
WITH_HOLES = ("torus", "double_torus", "mug", "nut", "cage", "truss")
# The cylinder of figure 6.6 [m].
RADIUS, HALF_HEIGHT, HOLE, FLOOR = 0.016, 0.014, 0.011, 0.004
PRESSED = (0.001, 0.003)

Maker = Callable[[Collider], Correction]


def followed(correction: StaticCorrection, rows: Array, poses: Sequence[RigidPose]) -> Array:
    """The displacements (p, n, dim) [m] along a path (p,), each contact solved from the one before."""
    near, found = None, []
    for pose in poses:
        near = correction.solve(rows, pose, near)
        found.append(correction.displacement_of(near, rows, pose))
    return np.stack(found)


def unsteady(
    correction: StaticCorrection, points: Array, rows: Array, poses: Sequence[RigidPose]
) -> tuple[float, float]:
    """The fastest point, and the flicker, along a path. points: (n, dim) [m] where the points are, about."""
    u = followed(correction, rows, poses)
    first, second = np.diff(u, axis=0), np.diff(u, n=2, axis=0)
    moved = np.stack([b.apply(a.apply_inverse(points)) - points for a, b in pairwise(poses)])
    speed = np.linalg.norm(first, axis=2) / np.linalg.norm(moved, axis=2)
    return float(speed.max()), float(np.sqrt(np.square(second).mean() / np.square(first).mean()))


def jumps(
    make: Maker, body: ReducedBody, truth: TruthData, colliders: dict[str, Collider], steps: int
) -> Array:
    """`unsteady` of each path (p, 2)."""
    nodes = body.surface.nodes
    found = []
    for name, collider in colliders.items():
        correction = StaticCorrection(make(collider), body, nodes)
        for rows, poses in paths(truth, name, steps, contacts=1):
            found.append(unsteady(correction, body.basis[nodes] @ rows, rows, poses))
    return np.array(found)


def cylinders() -> tuple[Collider, Collider]:
    """The solid one, and the one with a hole from above; both stand on a flat face."""
    solid = Cylinder(RADIUS, HALF_HEIGHT, 1e-3, "solid")
    hole = Cylinder(HOLE, HALF_HEIGHT, 1e-3, "hole")
    up = RigidPose(np.eye(3), np.array([0.0, 0.0, FLOOR]))
    return solid, SmoothDifference(Cylinder(RADIUS, HALF_HEIGHT, 1e-3), [Placed(hole, up)], 1e-3, "void")


def seen_void(make: Maker, body: ReducedBody) -> list[float]:
    """What a hole behind changes, relative, at each depth."""
    top = body.mesh.points[:, 2].max()
    poses = [RigidPose(np.eye(3), np.array([0.0, 0.0, top + HALF_HEIGHT - depth])) for depth in PRESSED]
    solid, void = (
        followed(StaticCorrection(make(collider), body, body.surface.nodes), body.rest_rows, poses)
        for collider in cylinders()
    )
    return [
        float(np.linalg.norm(other - u) / np.linalg.norm(u)) for u, other in zip(solid, void, strict=True)
    ]


def variants(run: Path, body: ReducedBody) -> dict[str, list[DescriptorModel]]:
    """The trained variants of a run, one a seed."""
    found = {
        name: [
            load_variant(path, body)
            for path in sorted((run / "variants").glob(f"{name.replace(' ', '_')}_*"))
        ]
        for name in VARIANTS
    }
    if not all(found.values()):
        raise SoftprintError(
            f"{run / 'variants'}: not all variants are there: run reproduction.thesis6_ablation first"
        )
    return found


def bracketed(values: Sequence[float], form: str) -> str:
    """Mean (lowest to highest)."""
    return f"{np.mean(values):{form}} ({min(values):{form}} to {max(values):{form}})"


def main() -> None:
    """Measure, print, draw."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("experiment", type=Path)
    parser.add_argument("--out", type=Path, help="run directory (default: runs/NAME)")
    parser.add_argument("--steps", type=int, default=25, help="of each path, 20 um each")
    parser.add_argument("--plot", type=Path, metavar="FILE.png")
    options = parser.parse_args()
    context = Context(experiment_path=options.experiment, overrides=(), out=options.out, quiet=True)
    experiment, body, run = context.experiment, body_of_run(context), context.out_dir
    trained = variants(run, body)
    rigid = {name: build_collider(experiment.collider(name), experiment.base_dir) for name in WITH_HOLES}
    known = {
        name: read_correction(correction_path(run, name), body).on
        for name in ("mechanics", "ours")
        if correction_path(run, name).is_file()
    }

    def makers(names: Sequence[str]) -> dict[str, list[Maker]]:
        """The networks of some variants, one a seed, and what else is known."""
        networks: dict[str, list[Maker]] = {
            name: [partial(direct_contact, model, body) for model in trained[name]] for name in names
        }
        return networks | {name: [make] for name, make in known.items()}

    jump: dict[str, list[float]] = {}
    void: dict[str, list[list[float]]] = {}
    print(f"jump, under {', '.join(WITH_HOLES)}\n")
    print("| | median path, mm/mm | fastest, mm/mm | flicker |\n| --- | --- | --- | --- |")
    with load_truth(run / "truth.h5", body) as truth:
        for name, makes in makers(("thesis6", "raw normal")).items():
            found = np.stack([jumps(make, body, truth, rigid, options.steps) for make in makes])
            jump[name] = found[:, :, 1].ravel().tolist()
            fastest, flicker = found[:, :, 0], np.sqrt(np.square(found[:, :, 1]).mean(axis=1))
            columns = (np.median(fastest, axis=1), fastest.max(axis=1), flicker)
            cells = [
                bracketed(list(column), form)
                for column, form in zip(columns, (".1f", ".1f", ".3f"), strict=True)
            ]
            print(f"| {name} | {' | '.join(cells)} |", flush=True)
    print("\n| what a hole behind changes | 1 mm deep | 3 mm |\n| --- | --- | --- |")
    for name, makes in makers(("thesis6", "half of the samples", "the centre alone")).items():
        void[name] = [seen_void(make, body) for make in makes]
        cells = [bracketed(list(column), ".1%") for column in zip(*void[name], strict=True)]
        print(f"| {name} | {' | '.join(cells)} |", flush=True)
    measured = {"jump": jump, "void": void}
    with atomic_path(run / "thesis6_figures.json") as temporary:
        temporary.write_text(json.dumps(measured, indent=1))
    if options.plot:
        from reproduction.thesis6_plots import draw

        draw(run, options.plot)


if __name__ == "__main__":
    run_script(main)
