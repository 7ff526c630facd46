"""A truth sample at several sizes of the mesh, solved the straightforward way, the thesis's way, and ours.

    python -m benchmarks.truth_scale [--sizes 15000 60000 250000] [--contacts 4] [--ways naive thesis ours]

For each size and way: CPU seconds a sample on one core, iterations of Newton and of CG, the error of the contact
displacement (relative L2 norm) against the same sample solved to 1e-8, and where the time goes. The meshes are those of
meshes/jelly.py, made at first use (needs gmsh) and kept with their bodies in --bodies; states and contacts as in
benchmarks.truth_speed. The first contact is solved once more, timed function by function, for the split.
"""

from __future__ import annotations

import argparse
import resource
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from benchmarks.stopwatch import Stopwatch
from benchmarks.truth_rivals import NaiveSolver, Outcome, Rival, ThesisSolver
from benchmarks.truth_speed import DEFAULT, TIGHT, random_approach, recorded_states
from softprint.fem_truth.elasticity.full_space_elasticity import FullSpaceElasticity
from softprint.fem_truth.energy.surface_contact import SurfaceContact
from softprint.fem_truth.linalg.block_kernels import BlockKernels
from softprint.fem_truth.linalg.null_space import NullSpace
from softprint.fem_truth.statics.constrained import CONTACT_SETTINGS, ConstrainedProblem
from softprint.runtime.arrays import Array
from softprint.runtime.body import ReducedBody
from softprint.runtime.body.body_file import load_body, save_body
from softprint.runtime.body.build import build_body
from softprint.runtime.cli.script import run_script
from softprint.runtime.colliders.build import build_collider
from softprint.runtime.colliders.collider import Collider
from softprint.runtime.colliders.pose import RigidPose
from softprint.runtime.contact import PenaltyContact
from softprint.runtime.experiment import Experiment, load_experiment
from softprint.runtime.mesh import write_mesh

# A uniform Jelly of this edge length [m] has so many cells; the number goes with the cube of the length.
EDGE_LENGTH, CELLS = 0.0029, 61_199
# A rival that has not converged after so many iterations is not going to.
RIVAL_SETTINGS = replace(CONTACT_SETTINGS, newton=replace(CONTACT_SETTINGS.newton, max_iterations=25))
WAYS = {
    "naive": "DOLFINx assembles, MUMPS factorises the saddle-point matrix in every Newton iteration",
    "thesis": "CG projected onto the null space of U, diagonal preconditioner, matrix assembled in every iteration",
    "ours": "fem_truth.statics.constrained as it is",
}


@dataclass(frozen=True, eq=False)
class Contact:
    """One contact of one state, from shallow to deep, and its answers (n_nodes, dim) solved to 1e-8."""

    rows: Array
    internal: Array
    poses: list[RigidPose]
    exact: list[Array]


Press = Callable[[Contact], list[Outcome]]


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--sizes", type=int, nargs="+", default=[15_000, 60_000], help="cells of the meshes")
    parser.add_argument("--contacts", type=int, default=2, help="each pressed in 5 depths (default: 2)")
    parser.add_argument(
        "--rival-contacts", type=int, default=1, help="of these, how many the other ways solve"
    )
    parser.add_argument("--ways", nargs="+", choices=list(WAYS), default=list(WAYS))
    parser.add_argument(
        "--largest-naive", type=int, default=100_000, help="cells beyond which the naive way is left out"
    )
    parser.add_argument("--bodies", type=Path, default=Path("runs/truth_scale"), help="default: %(default)s")
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    experiment = load_experiment(DEFAULT)
    for size in arguments.sizes:
        body = body_of_size(experiment, size, arguments.bodies)
        print(
            f"\n{body.mesh.n_cells} tetrahedra, {body.n_nodes} nodes, {body.constraint_basis.shape[1]} columns"
        )
        collider = build_collider(experiment.collider(experiment.sampling.collider), experiment.base_dir)
        gravity = np.array(experiment.dynamics.gravity)
        penalty = PenaltyContact.of(experiment.contact)
        problem = ConstrainedProblem(FullSpaceElasticity(body), gravity, penalty, body)
        contacts = make_contacts(experiment, problem, collider, arguments.contacts, arguments.seed)
        for way in arguments.ways:
            if way == "ours":
                report(way, contacts, ours(problem, collider), *watched_ours(problem, collider, contacts[0]))
                continue
            if way == "naive" and body.mesh.n_cells > arguments.largest_naive:
                print("naive : not run: minutes a sample, and many GiB for the factors (--largest-naive)")
                continue
            watch = Stopwatch()
            solver = {"naive": NaiveSolver, "thesis": ThesisSolver}[way](body, gravity, penalty, watch)

            few = contacts[: arguments.rival_contacts]
            report(way, few, theirs(solver, collider), watch)
        print(f"peak memory {resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20:.2f} GiB")


def body_of_size(experiment: Experiment, cells: int, folder: Path) -> ReducedBody:
    """The Jelly of the experiment with about so many cells, from the folder where it has been made before."""
    path = folder / f"jelly_{cells}.h5"
    if path.exists():
        return load_body(path)
    from meshes.jelly import mesh_jelly

    folder.mkdir(parents=True, exist_ok=True)
    edge = EDGE_LENGTH * (CELLS / cells) ** (1 / 3)
    mesh = folder.resolve() / f"jelly_{cells}.vtu"
    write_mesh(mesh, mesh_jelly(3, edge, edge))
    body = build_body(experiment.body.model_copy(update={"mesh": str(mesh)}), experiment.base_dir)
    save_body(path, body)
    return body


def make_contacts(
    experiment: Experiment, problem: ConstrainedProblem, collider: Collider, count: int, seed: int
) -> list[Contact]:
    scene = next(scene for scene in experiment.scenes if scene.role == "record")
    rng = np.random.default_rng(seed)
    depths = np.linspace(0, experiment.sampling.max_depth, experiment.sampling.depths + 1)[1:]
    contacts = []
    for rows in recorded_states(experiment, problem.body, scene, count):
        start = time.process_time()
        internal = problem.internal_equilibrium(rows)
        print(
            f"internal equilibrium: {internal.status.name}, {time.process_time() - start:.2f} s, "
            f"{internal.newton_iterations} Newton, {internal.cg_iterations} CG"
        )
        poses = random_approach(problem.body, internal.x, collider, rng).poses_at(depths)
        press = problem.press(rows, collider, internal.x)
        exact = [press.solve(pose, TIGHT) for pose in poses]
        assert all(solution.converged for solution in exact), "a sample cannot be solved to 1e-8"
        contacts.append(Contact(rows, internal.x, poses, [solution.x for solution in exact]))
    return contacts


def theirs(solver: Rival, collider: Collider) -> Press:
    return lambda contact: solver.press(collider, contact.poses, contact.internal, RIVAL_SETTINGS)


def ours(problem: ConstrainedProblem, collider: Collider) -> Press:
    def press(contact: Contact) -> list[Outcome]:
        outcomes, press = [], None
        for pose in contact.poses:
            start = time.process_time()
            press = press or problem.press(contact.rows, collider, contact.internal)
            solution = press.solve(pose)
            seconds = time.process_time() - start
            outcomes.append(
                Outcome(
                    solution.x,
                    solution.converged,
                    solution.newton_iterations,
                    solution.cg_iterations,
                    seconds,
                )
            )
        return outcomes

    return press


def watched_ours(problem: ConstrainedProblem, collider: Collider, contact: Contact) -> tuple[Stopwatch, int]:
    """One contact, timed function by function. `descend` has half of a projection in it; the timing itself adds some
    percent to the short ones."""
    watch, undo = Stopwatch(), []
    for owner, name, label in (
        (FullSpaceElasticity, "hessian", "assembly"),
        (FullSpaceElasticity, "energy_gradient", "energy"),
        (FullSpaceElasticity, "min_det_F", "energy"),
        (SurfaceContact, "terms", "contact"),
        (BlockKernels, "product", "CG product"),
        (BlockKernels, "coordinates", "projection"),
        (BlockKernels, "deflate", "projection"),
        (NullSpace, "project", "projection"),
        (BlockKernels, "descend", "preconditioner"),
        (BlockKernels, "inverses", "preconditioner"),
    ):
        undo.append((owner, name, getattr(owner, name)))
        watch.watch(owner, name, label)
    start = time.process_time()
    ours(problem, collider)(contact)
    total = time.process_time() - start
    for owner, name, function in undo:
        setattr(owner, name, function)
    watch.seconds["rest"] = total - sum(watch.seconds.values())
    return watch, len(contact.poses)


def report(
    way: str, contacts: list[Contact], press: Press, watch: Stopwatch, watched_samples: int | None = None
) -> None:
    """Solve the contacts and print a line on them, and one on where the time went in the samples that were watched:
    in all of these, if their number is not given."""
    outcomes, errors = [], []
    for contact in contacts:
        for outcome, exact in zip(press(contact), contact.exact):
            displacement = np.linalg.norm(exact - contact.internal)
            outcomes.append(outcome)
            errors.append(float(np.linalg.norm(outcome.x - exact) / displacement))
    good = [error for error, outcome in zip(errors, outcomes) if outcome.converged]
    accuracy = (
        f"error median {np.median(good):.1e}, 95 % {np.quantile(good, 0.95):.1e}, worst {max(good):.1e}"
        if good
        else "no error to tell"
    )
    wanted = sum(len(contact.poses) for contact in contacts)
    seconds = float(np.mean([outcome.seconds for outcome in outcomes]))
    print(
        f"{way:7s}{seconds:8.3f} s a sample, {np.mean([o.newton for o in outcomes]):5.2f} Newton, "
        f"{np.mean([o.cg for o in outcomes]):6.1f} CG, {accuracy}; {len(good)} of {wanted} converged"
    )
    split = sorted(watch.seconds.items(), key=lambda entry: -entry[1])
    samples = watched_samples or len(outcomes)
    print("       of which " + ", ".join(f"{name} {t / samples:.3f}" for name, t in split), flush=True)


if __name__ == "__main__":
    run_script(main)
