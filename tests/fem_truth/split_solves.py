"""Run under mpirun by test_parts.py: solves of a block, whole on each rank, and partitioned over all ranks. Prints the
results of every rank as JSON, because they must all be equal. Arguments: cases, as "2 linear 2": dimension, material,
and refinement of contact."""

from __future__ import annotations

import json
import sys
from dataclasses import asdict

import numpy as np
from mpi4py import MPI

from softprint.fem_truth.elasticity.full_space_elasticity import FullSpaceElasticity
from softprint.fem_truth.parts.body_part import BodyPart, part_of_body, whole_body
from softprint.fem_truth.statics.constrained import ConstrainedProblem, Solution
from softprint.fem_truth.statics.newton import FullSpaceSettings
from softprint.runtime.arrays import Array
from softprint.runtime.body import ReducedBody, assemble_body, frame_in_box, place_handles
from softprint.runtime.colliders import Box, RigidPose, Sphere
from softprint.runtime.contact import PenaltyContact
from softprint.runtime.elasticity import make_material
from softprint.runtime.io.files import content_hash
from softprint.runtime.mesh import box_mesh
from softprint.runtime.optimise import NewtonSettings

SIZES = {2: ([-0.05, 0.0], [0.05, 0.05], [14, 7]), 3: ([-0.05, -0.05, 0.0], [0.05, 0.05, 0.05], [6, 6, 3])}
TIGHT = FullSpaceSettings(NewtonSettings(60, 1e-10), 1e-16, cg_tolerance_min=1e-8)


def block(dim: int, model: str) -> ReducedBody:
    """A block with a stiffer upper half, a frame at its base, and six point handles."""
    mesh = box_mesh(*SIZES[dim])
    base = frame_in_box(mesh, "base", [[-1.0] * dim, [1.0] * (dim - 1) + [0.018]])
    young = np.where(mesh.cell_centroids[:, -1] > 0.025, 2e4, 1e4)
    material = make_material(model, young, np.full(mesh.n_cells, 0.4))
    return assemble_body(mesh, place_handles(mesh, 6, [base]), material, 1000.0, name=f"block{dim}d")


def solutions(body: ReducedBody, part: BodyPart, refinement: int) -> dict[str, Solution]:
    """An internal equilibrium; a press to two depths, loosely and tightly converged; and its linear response."""
    problem = ConstrainedProblem(
        FullSpaceElasticity(body, part=part),
        np.array([0.0] * (body.dim - 1) + [-9.81]),
        PenaltyContact(1e9, refinement),
        body,
    )
    rows = body.rest_rows.copy()
    rows[:6] += 1e-3 * np.random.default_rng(4).standard_normal((6, body.dim))
    internal = problem.internal_equilibrium(rows)
    found = {"internal": internal}
    poses = [pressed(body.dim, depth) for depth in (0.003, 0.006)]
    # With contact on facets the edges of a plate are pressed in, at the seam between ranks.
    ball = Box(np.array([0.001, 0.02, 0.015])[-body.dim :][::1]) if refinement else Sphere(0.015, body.dim)
    for name, settings in (("loose", FullSpaceSettings()), ("tight", TIGHT)):
        press = problem.press(rows, ball, internal.x)
        found |= {f"{name} {depth}": press.solve(pose, settings) for depth, pose in enumerate(poses)}
    found["linear"] = problem.linear_response(rows, ball, poses[-1], internal.x, TIGHT)
    return found


def pressed(dim: int, depth: float) -> RigidPose:
    return RigidPose(np.eye(dim), np.array([0.0] * (dim - 1) + [0.065 - depth]))


def difference(x: Array, y: Array, internal: Array) -> float:
    """The largest difference, relative to the largest contact displacement."""
    return float(np.abs(x - y).max() / np.abs(x - internal).max())


def main() -> None:
    results = {}
    for case in sys.argv[1:]:
        dim, model, refined = case.split()
        body, refinement = block(int(dim), model), int(refined)
        part = part_of_body(body, MPI.COMM_WORLD)
        whole, split = (solutions(body, own, refinement) for own in (whole_body(body), part))
        internal = whole["internal"].x
        differences = {
            name: difference(whole[name].x, split[name].x, internal) for name in whole if name != "internal"
        }
        differences["internal"] = difference(internal, split["internal"].x, body.mesh.points)
        numbers = {name: str({**asdict(s), "x": content_hash({"x": s.x})}) for name, s in split.items()}
        results[case] = {
            "refined": refinement > 0,
            "cells": part.mesh.n_cells,
            "all cells": body.mesh.n_cells,
            "differences": differences,
            "newton": [[s.newton_iterations for s in one.values()] for one in (whole, split)],
            "cg": [[s.cg_iterations for s in one.values()] for one in (whole, split)],
            "converged": all(s.converged for s in split.values()),
            "eigenvalues": [s["internal"].min_eigenvalue for s in (whole, split)],
            "depths": [s["tight 1"].max_depth for s in (whole, split)],
            "energies": [s["tight 1"].energy for s in (whole, split)],
            "answer": content_hash(numbers),
        }
    by_rank = MPI.COMM_WORLD.gather(results)
    if by_rank is not None:
        print(json.dumps(by_rank))


if __name__ == "__main__":
    main()
