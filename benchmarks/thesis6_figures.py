"""Figures 6.3 to 6.7 of the thesis as numbers, and drawn on one page.

    python -m benchmarks.thesis6_figures EXPERIMENT [--out RUN] [--steps 25] [--plot FILE.png]

Needs the variants that `thesis6_ablation.py` has trained, and for the plot what `descriptor_ways.py` wrote too. Prints,
as means over the seeds that were trained, with the lowest and the highest in brackets:

    jump    (6.3) for the thesis's smoothed normal and the raw gradient: how fast a surface sample's displacement
            changes at most while a collider with holes is moved slowly along the paths of `descriptor_ways.py`
            [mm/mm]; where it is discontinuous, as fast as one likes, if only steps are short. Median over all paths,
            and the largest.
    void    (6.6) a cylinder pressed flat into the body at rest, and one with a blind hole from behind that leaves a
            floor thicker than it is pressed in: sqrt(<|u_void - u_solid|^2> / <|u_solid|^2>) over the surface samples.
            The body cannot feel the hole, so all of it is error.

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

from benchmarks.descriptor_ways import direct_contact, paths
from benchmarks.thesis6_ablation import VARIANTS, load_variant
from runtime.arrays import Array
from runtime.body.body import ReducedBody
from runtime.cli.context import Context
from runtime.cli.run_body import body_of_run
from runtime.colliders import Cylinder, Placed, RigidPose, SmoothDifference
from runtime.colliders.build import build_collider
from runtime.colliders.collider import Collider
from runtime.corrections.correction import BoundCorrection, Correction
from runtime.corrections.correction_file import correction_maker
from runtime.corrections.descriptor_model import DescriptorModel
from runtime.dynamics.model import correction_path
from runtime.errors import SoftprintError
from runtime.files import atomic_path
from runtime.truth_file import TruthData, load_truth

# Testing shapes with holes: many points at which the nearest point of the surface changes.
WITH_HOLES = ("torus", "double_torus", "mug", "nut", "cage", "truss")
# The cylinder of figure 6.6 [m].
RADIUS, HALF_HEIGHT, HOLE, FLOOR, PRESSED = 0.016, 0.014, 0.011, 0.004, (0.001, 0.002, 0.003)

Maker = Callable[[Collider], Correction]


def fastest(bound: BoundCorrection, points: Array, rows: Array, poses: Sequence[RigidPose]) -> float:
    """Largest change of a displacement over the motion of the collider there, from step to step of a path.

    points: (n, dim) [m] where the points are, about."""
    largest, before = 0.0, bound.displacement(rows, poses[0])
    for last, pose in pairwise(poses):
        u = bound.displacement(rows, pose)
        moved = np.linalg.norm(pose.apply(last.apply_inverse(points)) - points, axis=1)
        largest, before = max(largest, float((np.linalg.norm(u - before, axis=1) / moved).max())), u
    return largest


def jumps(
    make: Maker, body: ReducedBody, truth: TruthData, colliders: dict[str, Collider], steps: int
) -> list[float]:
    """`fastest` of each path."""
    nodes = body.node_points(body.surface.nodes)
    found = []
    for name, collider in colliders.items():
        bound = make(collider).bind(nodes)
        for rows, poses in paths(truth, name, steps, contacts=2):
            found.append(fastest(bound, nodes.basis @ rows, rows, poses))
    return found


def cylinders() -> tuple[Collider, Collider]:
    """The solid one, and the one with a hole from above; both stand on a flat face."""
    solid = Cylinder(RADIUS, HALF_HEIGHT, 1e-3, "solid")
    hole = Cylinder(HOLE, HALF_HEIGHT, 1e-3, "hole")
    up = RigidPose(np.eye(3), np.array([0.0, 0.0, FLOOR]))
    return solid, SmoothDifference(Cylinder(RADIUS, HALF_HEIGHT, 1e-3), [Placed(hole, up)], 1e-3, "void")


def seen_void(make: Maker, body: ReducedBody) -> float:
    """What a hole behind changes, relative."""
    nodes, top = body.node_points(body.surface.nodes), body.mesh.points[:, 2].max()
    solid, void = (make(collider).bind(nodes) for collider in cylinders())
    apart = whole = 0.0
    for pressed in PRESSED:
        pose = RigidPose(np.eye(3), np.array([0.0, 0.0, top + HALF_HEIGHT - pressed]))
        u, other = (bound.displacement(body.rest_rows, pose) for bound in (solid, void))
        apart, whole = apart + float(np.square(other - u).sum()), whole + float(np.square(u).sum())
    return float(np.sqrt(apart / whole))


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
            f"{run / 'variants'}: not all variants are there: run benchmarks.thesis6_ablation first"
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
    measured: dict[str, dict[str, list[float]]] = {"jump": {}, "void": {}}
    print(f"jump, mm/mm, under {', '.join(WITH_HOLES)}\n\n| | median path | largest |\n| --- | --- | --- |")
    known = {
        name: correction_maker(correction_path(run, name), body)
        for name in ("mechanics", "ours")
        if correction_path(run, name).is_file()
    }
    with load_truth(run / "truth.h5", body) as truth:
        for name, models in [(name, trained[name]) for name in ("thesis6", "raw normal")]:
            found = [
                jumps(partial(direct_contact, model, body), body, truth, rigid, options.steps)
                for model in models
            ]
            measured["jump"][name] = np.concatenate(found).tolist()
            each = (bracketed([float(f(own)) for own in found], ".1f") for f in (np.median, np.max))
            print(f"| {name} | {' | '.join(each)} |", flush=True)
        for name, make in known.items():
            own = jumps(make, body, truth, rigid, options.steps)
            measured["jump"][name] = own
            print(f"| {name} | {np.median(own):.1f} | {max(own):.1f} |", flush=True)
    print("\n| | what a hole behind changes |\n| --- | --- |")
    for name in ("thesis6", "half of the samples", "the centre alone"):
        own = [seen_void(partial(direct_contact, model, body), body) for model in trained[name]]
        measured["void"][name] = own
        print(f"| {name} | {bracketed(own, '.1%')} |", flush=True)
    for name, make in known.items():
        measured["void"][name] = [seen_void(make, body)]
        print(f"| {name} | {measured['void'][name][0]:.1%} |", flush=True)
    with atomic_path(run / "thesis6_figures.json") as temporary:
        temporary.write_text(json.dumps(measured, indent=1))
    if options.plot:
        from benchmarks.thesis6_plots import draw

        draw(run, options.plot)


if __name__ == "__main__":
    main()
