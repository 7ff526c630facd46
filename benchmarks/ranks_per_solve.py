"""What it costs to let several ranks solve together, and a model of large runs fitted to it (docs/large_runs.md).

    python -m benchmarks.ranks_per_solve [--sizes 15000 60000] [--ranks 1 2 3 4] [--bodies DIR]

For each size of the Jelly and each number K of ranks that share it, one contact is pressed to five depths. Counted are
processor seconds of the rank that works longest, without what it spends in sums and exchanges (there it mostly waits
for others, the longer the busier the machine), the messages and bytes it sends, and its memory. So the figures mean the
same where K is more than there are cores. Fitted to them:

    iterations(T) = b T^gamma             of CG, a contact of T cells
    work(T, K)    = iterations(T) (e + a T / K)    processor seconds a contact and rank: calls, and cells
    traffic(T)    = c T^(2/3)             bytes a rank sends in an iteration, through the cuts between parts
    memory(T, K)  = m0 + m1 T + m2 T / K  of a rank: Python, the whole body, its part
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import h5py  # noqa: F401  (before DOLFINx)
import numpy as np
from mpi4py import MPI
from scipy.optimize import nnls

from benchmarks.stopwatch import Stopwatch
from benchmarks.truth_scale import body_of_size
from benchmarks.truth_speed import DEFAULT, random_approach, recorded_states
from softprint.fem_truth.elasticity.full_space_elasticity import FullSpaceElasticity
from softprint.fem_truth.parts.body_part import part_of_body
from softprint.fem_truth.statics.constrained import ConstrainedProblem
from softprint.runtime.arrays import Array
from softprint.runtime.body.body_file import load_body
from softprint.runtime.cli.script import run_script
from softprint.runtime.colliders.build import build_collider
from softprint.runtime.colliders.pose import RigidPose
from softprint.runtime.contact import PenaltyContact
from softprint.runtime.experiment import load_experiment

SUMS = ("total", "smallest", "largest", "stacked", "assemble", "gather")


class CountedComm:
    """A communicator that counts what this rank sends: one message a sum, one for each neighbour in an exchange."""

    def __init__(self, comm: MPI.Intracomm) -> None:
        self._comm, self.messages, self.bytes = comm, 0, 0

    def __getattr__(self, name: str) -> Any:
        inner = getattr(self._comm, name)
        if name not in ("Isend", "Allgather", "Allgatherv"):
            return inner

        def counted(buffer: Any, *others: Any, **keywords: Any) -> Any:
            self.messages += 1
            self.bytes += buffer[0].nbytes
            return inner(buffer, *others, **keywords)

        return counted


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--sizes", type=int, nargs="+", default=[15_000, 60_000], help="cells of the meshes")
    parser.add_argument("--ranks", type=int, nargs="+", default=[1, 2, 3, 4], help="that share a body")
    parser.add_argument("--bodies", type=Path, default=Path("runs/truth_scale"), help="default: %(default)s")
    parser.add_argument("--worker", type=Path, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.worker:
        measure(options.worker)
        return
    rows = []
    print("   cells  K  cells/rank nodes/rank  work s  waited s    CG  messages/CG  kB/CG  MiB/rank")
    for size in options.sizes:
        case = prepared(size, options.bodies)
        for ranks in options.ranks:
            row = run(case, ranks)
            rows.append(row)
            print(
                f"{row['all_cells']:8.0f} {ranks:2d} {row['cells']:11.0f} {row['nodes']:10.0f} {row['work']:7.2f} "
                f"{row['waited']:9.2f} {row['cg']:5.0f} {row['messages'] / row['cg']:12.1f} "
                f"{row['bytes'] / row['cg'] / 1e3:6.1f} {row['memory']:9.0f}",
                flush=True,
            )
    print_model(rows)


def prepared(size: int, folder: Path) -> Path:
    """A state, its internal equilibrium and the poses of a press, kept beside the body of this size."""
    experiment = load_experiment(DEFAULT)
    body = body_of_size(experiment, size, folder)
    path = folder / f"contact_{size}.npz"
    if not path.exists():
        collider = build_collider(experiment.collider(experiment.sampling.collider), experiment.base_dir)
        problem = ConstrainedProblem(
            FullSpaceElasticity(body), np.array(experiment.dynamics.gravity), PenaltyContact(1.0), body
        )
        scene = next(scene for scene in experiment.scenes if scene.role == "record")
        rows = recorded_states(experiment, body, scene, 1)[0]
        internal = problem.internal_equilibrium(rows).x
        depths = np.linspace(0, experiment.sampling.max_depth, experiment.sampling.depths + 1)[1:]
        approach = random_approach(body, internal, collider, np.random.default_rng(0))
        poses = approach.poses_at(depths)
        translations = np.array([pose.translation for pose in poses])
        np.savez(path, rows=rows, internal=internal, rotation=poses[0].rotation, translations=translations)
    return path


def run(case: Path, ranks: int) -> dict[str, float]:
    """The worst rank of `measure` on so many ranks."""
    command = [
        "mpirun",
        "--oversubscribe",
        "-n",
        str(ranks),
        sys.executable,
        "-m",
        "benchmarks.ranks_per_solve",
    ]
    threads = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    done = subprocess.run(
        [*command, "--worker", str(case)],
        env={**os.environ, **threads},
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode != 0:
        raise SystemExit(f"{' '.join(command)} failed:\n{done.stderr}")
    by_rank: list[dict[str, float]] = json.loads(done.stdout)
    return {"ranks": ranks, **{name: max(row[name] for row in by_rank) for name in by_rank[0]}}


def measure(case: Path) -> None:
    """Press the contact on all ranks together; print what each of them did."""
    experiment, comm = load_experiment(DEFAULT), CountedComm(MPI.COMM_WORLD)
    body = load_body(case.with_name(case.stem.replace("contact", "jelly") + ".h5"))
    contact = np.load(case, allow_pickle=False)
    part = part_of_body(body, comm)  # type: ignore[arg-type]
    elasticity = FullSpaceElasticity(body, part=part)
    gravity = np.array(experiment.dynamics.gravity)
    problem = ConstrainedProblem(elasticity, gravity, PenaltyContact.of(experiment.contact), body)
    collider = build_collider(experiment.collider(experiment.sampling.collider), experiment.base_dir)
    watch = Stopwatch()
    for name in SUMS:
        if comm.size > 1:
            watch.watch(part.share, name, name)
    poses = [RigidPose(contact["rotation"], at) for at in contact["translations"]]
    for _ in range(2):  # the first time loads libraries and touches memory
        press = problem.press(contact["rows"], collider, contact["internal"])
        comm.messages = comm.bytes = 0
        watch.seconds.clear()
        began = time.process_time()
        solutions = [press.solve(pose) for pose in poses]
        total, waited = time.process_time() - began, sum(watch.seconds.values())
    found = {
        "all_cells": body.mesh.n_cells,
        "cells": part.mesh.n_cells,
        "nodes": part.mesh.n_nodes,
        "work": total - waited,
        "waited": waited,
        "cg": sum(solution.cg_iterations for solution in solutions),
        "messages": comm.messages,
        "bytes": comm.bytes,
        "memory": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**10,
        "converged": all(solution.converged for solution in solutions),
    }
    by_rank = comm.gather(found)
    if by_rank is not None:
        print(json.dumps(by_rank))


def print_model(rows: Sequence[dict[str, float]]) -> None:
    """Fit the formulas of the module and say what they make of larger bodies and runs."""
    columns = {name: np.array([row[name] for row in rows], dtype=float) for name in rows[0]}
    T, K = columns["all_cells"], columns["ranks"]
    ones = np.ones_like(T)
    log_b, gamma = np.linalg.lstsq(np.column_stack([ones, np.log(T)]), np.log(columns["cg"]), rcond=None)[0]
    e, a = fitted(np.column_stack([ones, T / K]), columns["work"] / columns["cg"])
    split = K > 1
    (c,) = fitted(T[split, None] ** (2 / 3), (columns["bytes"] / columns["cg"])[split])
    m0, m1, m2 = fitted(np.column_stack([ones, T, T / K]), columns["memory"])
    print(
        f"\niterations(T) = {np.exp(log_b):.3g} T^{gamma:.2f} of CG a contact"
        f"\nwork(T, K)    = iterations(T) ({1e6 * e:.0f} + {1e9 * a:.2f} T/1000/K) microseconds a contact and rank"
        f"\ntraffic(T)    = {c:.3g} T^(2/3) bytes an iteration"
        f"\nmemory(T, K)  = {m0:.0f} + {1e3 * m1:.2f} T/1000 + {1e3 * m2:.2f} T/1000/K MiB a rank"
    )
    print("off by at most", end=" ")
    work = columns["cg"] * (e + a * T / K) / columns["work"]
    memory = (m0 + m1 * T + m2 * T / K) / columns["memory"]
    print(", ".join(f"{np.abs(r - 1).max():.0%} in {of}" for of, r in (("work", work), ("memory", memory))))


def fitted(matrix: Array, values: Array) -> Array:
    """Least squares of relative errors, and no coefficient below 0."""
    return np.asarray(nnls(matrix / values[:, None], np.ones_like(values))[0])


if __name__ == "__main__":
    run_script(main)
