"""Two equal colliders that come nearer: corrections of one, added up, and both solved together (thesis 4.3.1 and 4.4).

    softprint run examples/jelly2d_circle_small.toml
    python -m reproduction.superposition examples/jelly2d_circle_small.toml --components 50 --widths 100 100 \\
        [--picture FILE.png]

Both are pressed into the top of the body at rest, side by side. Printed is, for each distance between their centres in
units of their size, the error of the displacement by contact against full space with both,
sqrt(sum |u - u*|^2 / sum |u*|^2) over the nodes, a table in Markdown:

    exact, added up             of full space with one collider, and with the other
    object-centric, added up    r_ext of one model for each of them (eq. 4.7), learned from contact with one
    others                      corrections of the run, with both contacts solved together

The last line is the error with one of them alone. The picture shows the body at the second-shortest distance, and below
it the distance of every node from full space.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from reproduction.object_centric import Recipe, arguments, context_of, learned, truth_path
from softprint.fem_truth.elasticity.full_space_elasticity import FullSpaceElasticity
from softprint.fem_truth.energy.surface_contact import SurfaceContact
from softprint.fem_truth.report.drawing.panels import save_panels
from softprint.fem_truth.report.drawing.renderings import make_renderer
from softprint.fem_truth.report.run_files import find_run_files
from softprint.fem_truth.statics.constrained import ConstrainedProblem
from softprint.runtime.arrays import Array
from softprint.runtime.body import ReducedBody
from softprint.runtime.cli.run_body import body_of_run
from softprint.runtime.cli.script import run_script
from softprint.runtime.colliders.collider import Collider
from softprint.runtime.colliders.combine import Placed, SmoothUnion
from softprint.runtime.colliders.pose import RigidPose
from softprint.runtime.contact.condensed.condensed_contact import CondensedContact
from softprint.runtime.contact.penalty import PenaltyContact
from softprint.runtime.errors import SoftprintError
from softprint.runtime.experiment import Experiment
from softprint.runtime.learned.correction import ContactCorrection
from softprint.runtime.learned.correction_file import load_correction
from softprint.runtime.truth.truth_file import load_truth
from softprint.surrogate.data.training_data import TrainingData

FULL_SPACE = "full space, both"
Found = Mapping[str, Array]
# A contact is followed from its first touch in so many steps.
STEPS = 6


class FullSpace:
    """Exact displacements by contact of a body at rest with any number of equal colliders."""

    def __init__(self, experiment: Experiment, body: ReducedBody, collider: Collider) -> None:
        self._law, self._collider, self._rows = (
            PenaltyContact.of(experiment.contact),
            collider,
            body.rest_rows,
        )
        gravity = np.array(experiment.dynamics.gravity)
        self._problem = ConstrainedProblem(FullSpaceElasticity(body), gravity, self._law, body)
        self.internal = self._problem.internal_equilibrium(self._rows).x

    def displacement(self, paths: Sequence[Sequence[RigidPose]]) -> Array:
        """u (n_nodes, dim) [m] at the ends of the paths of the colliders, all followed together. Raises SoftprintError
        where a solve does not converge."""
        problem, alone, x = self._problem, self._problem.terms, self.internal
        for poses in zip(*paths, strict=True):
            problem.terms = (*alone, *(self._contact(pose) for pose in poses[1:]))
            found = problem.solve(self._rows, self._collider, poses[0], x, internal=self.internal)
            problem.terms = alone
            if not found.converged:
                raise SoftprintError(f"full space: {found.reason}")
            x = found.x
        return x - self.internal

    def _contact(self, pose: RigidPose) -> SurfaceContact:
        return self._problem.surface_contact(self._rows, self._collider, pose)


def together(body: ReducedBody, correction: ContactCorrection, paths: Sequence[Sequence[RigidPose]]) -> Array:
    """u (n_nodes, dim) [m] of a contact correction, with the contacts of all colliders solved together."""
    names = [f"{correction.collider} {number}" for number in range(len(paths))]
    contact = CondensedContact.of(
        body,
        correction.mechanics,
        dict.fromkeys(names, correction.shape),
        correction.law,
        correction.band,
        correction.learned,
    )
    rows, solved = body.rest_rows, None
    for poses in zip(*paths, strict=True):
        start = contact.resume(solved)
        own = dict(zip(names, poses, strict=True))
        solved = contact.evaluate(contact.in_frame(rows), rows, own, start).solved
    assert solved is not None  # every path has an end
    points = body.node_points()
    return np.asarray(sum(correction.bind(points, contact, name).displacement(solved) for name in names))


def paths_at(
    body: ReducedBody, positions: Array, size: float, depth: float, places: Sequence[float]
) -> list[list[RigidPose]]:
    """The way of each collider of this size down to a depth [m] in the top of the body, whose nodes are at positions
    (n_nodes, dim), at places along the first axis [m]."""
    top = positions[body.mesh.surface_nodes]
    paths = []
    for place in places:
        near = top[np.abs(top[:, 0] - place) < 0.5 * size]
        centre = np.zeros(body.dim)
        centre[0] = place
        path = []
        for step in range(1, STEPS + 1):
            centre[-1] = near[:, -1].max() + size - depth * step / STEPS
            path.append(RigidPose(np.eye(body.dim), centre.copy()))
        paths.append(path)
    return paths


def picture(
    path: Path,
    full: FullSpace,
    body: ReducedBody,
    collider: Collider,
    ends: Sequence[RigidPose],
    found: Found,
) -> None:
    """The body by full space and by some models, and the error of each below."""
    both = SmoothUnion([Placed(collider, end) for end in ends], 1e-6)
    renderer, still = (
        make_renderer(body.mesh, both, RigidPose.identity(body.dim)),
        RigidPose.identity(body.dim),
    )
    exact = found[FULL_SPACE]
    away = {name: np.linalg.norm(u - exact, axis=1) for name, u in found.items()}
    worst = 1e3 * max(values.max() for values in away.values())
    above, below = [], []
    for name, u in found.items():
        above.append((name, renderer.outside(full.internal + u, still, "")))
        title = f"off by at most {1e3 * away[name].max():.2f} mm"
        below.append((title, renderer.heat(full.internal + u, 1e3 * away[name], worst, "")))
    save_panels(path, [above, below])


def error(found: Array, exact: Array) -> str:
    return f"{np.sqrt(np.square(found - exact).sum() / np.square(exact).sum()):.1%}"


def corrections_of(
    files: Mapping[str, Path], body: ReducedBody, collider: Collider
) -> dict[str, ContactCorrection]:
    """The contact corrections of a run, by name."""
    loaded = {name: load_correction(path, body, collider) for name, path in files.items()}
    return {name: own for name, own in loaded.items() if isinstance(own, ContactCorrection)}


def main() -> None:
    parser = arguments(__doc__)
    parser.add_argument("--depth", type=float, default=0.004, help="of each [m] (default: 0.004)")
    parser.add_argument(
        "--apart",
        type=float,
        nargs="+",
        default=[6.0, 4.0, 3.0, 2.5, 2.1],
        help="distances of the centres over the size (default: 6 4 3 2.5 2.1)",
    )
    parser.add_argument("--picture", type=Path, metavar="FILE.png")
    given = parser.parse_args()
    context = context_of(given)
    try:
        files, body = find_run_files(context.out_dir, context.experiment), body_of_run(context)
        with load_truth(truth_path(files, context), body) as truth:
            data = TrainingData(truth, body, context)
            collider = data.build(data.collider)
            recipe = Recipe(given.widths, given.components, given.steps, "contact")
            model = learned(data, data.split.train, recipe).displacement
        corrections = corrections_of(files.corrections, body, collider)
        full, rows, size = FullSpace(context.experiment, body, collider), body.rest_rows, collider.size
        names = ["exact, added up", "object-centric, added up", *corrections]
        print("| apart | " + " | ".join(names) + " |\n" + "| --- " * (1 + len(names)) + "|")
        for apart in [*given.apart, None]:
            places = [0.0] if apart is None else [-0.5 * apart * size, 0.5 * apart * size]
            paths = paths_at(body, full.internal, size, given.depth, places)
            exact = full.displacement(paths)
            found = [
                sum(full.displacement([path]) for path in paths),
                sum(model(rows, path[-1]) for path in paths),
                *(together(body, own, paths) for own in corrections.values()),
            ]
            fields = {name: np.asarray(own) for name, own in zip(names, found, strict=True)}
            cells = " | ".join(error(own, exact) for own in fields.values())
            print(f"| {'one alone' if apart is None else f'{apart:g}'} | {cells} |", flush=True)
            if given.picture and apart == given.apart[-2:][0]:
                ends = [path[-1] for path in paths]
                picture(given.picture, full, body, collider, ends, {FULL_SPACE: exact, **fields})
    except SoftprintError as problem:
        parser.error(str(problem))


if __name__ == "__main__":
    run_script(main)
