"""Contacts with a given reduced state against a dense saddle-point solve that shares no code with Softprint's."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from softprint.fem_truth.elasticity.full_space_elasticity import FullSpaceElasticity
from softprint.fem_truth.statics.constrained import ConstrainedProblem
from softprint.fem_truth.statics.newton import FullSpaceSettings
from softprint.fem_truth.verify.case import Case, CaseResult, Row
from softprint.fem_truth.verify.problems.import_witness import import_witness
from softprint.runtime.arrays import Array, IntArray
from softprint.runtime.body import ReducedBody, assemble_body, frame_in_box, place_handles
from softprint.runtime.colliders import RigidPose, Sphere
from softprint.runtime.contact import PenaltyContact
from softprint.runtime.elasticity.materials import make_material
from softprint.runtime.errors import SoftprintError
from softprint.runtime.mesh import box_mesh
from softprint.runtime.optimise import NewtonSettings

if TYPE_CHECKING:
    from softprint.fem_truth.verify.problems.witness import Witness

YOUNG, POISSON, DENSITY = 2e4, 0.4, 1000.0
STIFFNESS = 1e9  # N/m^4
RADIUS, DEPTH = 0.015, 0.006  # m
_SETTINGS = FullSpaceSettings(NewtonSettings(60, 1e-10), 1e-14, cg_tolerance_min=1e-8)
_SOURCE = "Newton's method on the dense KKT system in numpy, elasticity assembled by scikit-fem"


def _body(dim: int, points: int, quick: bool) -> ReducedBody:
    """A block on a rigid slab, with that many point handles."""
    fine = {2: [16, 8], 3: [6, 6, 4]}[dim] if not quick else {2: [10, 5], 3: [4, 4, 3]}[dim]
    mesh = box_mesh([-0.05] * (dim - 1) + [0.0], [0.05] * dim, fine)
    slab = [[-1.0] * dim, [1.0] * (dim - 1) + [0.02]]
    handles = place_handles(mesh, points, [frame_in_box(mesh, "base", slab)])
    return assemble_body(mesh, handles, make_material("stable_neo_hookean", YOUNG, POISSON), DENSITY)


@dataclass(frozen=True, eq=False)
class _Ball:
    """Independent penalty contact with a ball: W = sum_i a_i k/3 max(0, R - |x_i - c|)^3 over surface nodes."""

    nodes: IntArray
    areas: Array
    centre: Array

    def derivatives(self, x: Array) -> tuple[Array, Array]:
        """Gradient (m, dim) and Hessian (m, dim, dim) at the surface nodes."""
        offset = x[self.nodes] - self.centre
        distance = np.linalg.norm(offset, axis=1)
        normal, depth = offset / distance[:, None], np.maximum(RADIUS - distance, 0.0)
        weight = STIFFNESS * self.areas
        outer = normal[:, :, None] * normal[:, None, :]
        bend = (np.eye(x.shape[1]) - outer) / distance[:, None, None]
        return (
            -(weight * depth**2)[:, None] * normal,
            (2 * weight * depth)[:, None, None] * outer - (weight * depth**2)[:, None, None] * bend,
        )


def dense_kkt(
    body: ReducedBody, rows: Array, witness: Witness, load: Array, ball: _Ball | None, start: Array
) -> Array:
    """Stationary point of W(x) - load . x + contact subject to C^T (x - U rows) = 0, with frames fixed, started from
    `start` (n, dim)."""
    n, dim = start.shape
    free = np.setdiff1d(np.arange(n), body.handles.frame_nodes)
    unknowns = (free[:, None] * dim + np.arange(dim)).ravel()
    constraint = np.kron(body.constraint_basis[free], np.eye(dim))
    count = constraint.shape[1]
    target = body.basis @ rows
    x = start.copy()
    x[body.handles.frame_nodes] = target[body.handles.frame_nodes]
    multipliers = np.zeros(count)
    for _ in range(40):
        gradient, hessian = witness.forces(x) - load, witness.stiffness(x).toarray()
        if ball is not None:
            slope, bend = ball.derivatives(x)
            gradient[ball.nodes] += slope
            blocks = hessian.reshape(n, dim, n, dim)
            blocks[ball.nodes, :, ball.nodes, :] += bend
        residual = np.concatenate(
            [
                gradient.ravel()[unknowns] + constraint @ multipliers,
                constraint.T @ (x - target).ravel()[unknowns],
            ]
        )
        system = np.block(
            [[hessian[np.ix_(unknowns, unknowns)], constraint], [constraint.T, np.zeros((count, count))]]
        )
        step = np.linalg.solve(system, -residual)
        x[free] += step[: len(unknowns)].reshape(-1, dim)
        multipliers += step[len(unknowns) :]
        if np.abs(step[: len(unknowns)]).max() < 1e-14:
            return x
    raise SoftprintError("the dense KKT solve did not converge")


def _row(what: str, ours: Array, theirs: Array, scale: float) -> Row:
    return Row(
        what,
        "",
        0.0,
        _SOURCE,
        float(np.abs(ours - theirs).max()) / scale,
        1e-7,
        "ours stops at a residual of 1e-10, and the condition number is some hundreds",
    )


def _compare(dim: int, points: int, quick: bool) -> list[Row]:
    witnesses = import_witness()
    body = _body(dim, points, quick)
    mesh = body.mesh
    gravity = np.array([0.0] * (dim - 1) + [-9.81])
    problem = ConstrainedProblem(
        FullSpaceElasticity(body), gravity, PenaltyContact(STIFFNESS, refinement=0), body
    )
    witness = witnesses.Witness(mesh, YOUNG, POISSON, "stable_neo_hookean")
    load = witness.weight(DENSITY * gravity)
    rows = body.rest_rows.copy()
    rows[:points] += 2e-3 * np.random.default_rng(4).standard_normal((points, dim))

    internal = problem.internal_equilibrium(rows, _SETTINGS)
    theirs = dense_kkt(body, rows, witness, load, None, body.reduced_positions(rows))
    label = f"{dim}D, {points} handles" if points else f"{dim}D, U empty"
    at_rest = float(np.abs(theirs - mesh.points).max())
    found = [_row(f"{label}, moved {1e3 * at_rest:.1f} mm, no contact", internal.x, theirs, at_rest)]

    top = float(internal.x[mesh.surface_nodes, -1].max())
    press = problem.press(rows, Sphere(RADIUS, dim), internal.x)
    solution, free = internal, theirs
    for depth in np.linspace(DEPTH / 3, DEPTH, 3):
        centre = np.array([0.0] * (dim - 1) + [top + RADIUS - depth])
        ball = _Ball(mesh.surface_nodes, mesh.surface_areas, centre)
        solution = press.solve(RigidPose(np.eye(dim), centre), _SETTINGS)
        theirs = dense_kkt(body, rows, witness, load, ball, theirs)
    if not solution.converged:
        raise SoftprintError(f"our own solve did not converge: {solution.reason}")
    moved = float(np.abs(theirs - free).max())
    found.append(_row(f"{label}, dented {1e3 * moved:.1f} mm by a ball", solution.x, theirs, moved))
    return found


def run(quick: bool) -> CaseResult:
    """A quick run has coarser bodies."""
    rows = [row for dim in (2, 3) for points in (4, 0) for row in _compare(dim, points, quick)]
    return CaseResult(tuple(rows))


CASE = Case(
    name="constrained",
    title="The constrained solver",
    statement=(
        "x = argmin W_elastic + W_gravity + W_contact subject to C^T (x - U q) = 0 on the nodes outside the "
        "rigid base, with C the columns of U that belong to point handles: the ground truth of contact "
        "displacements. Softprint solves it by truncated Newton with conjugate gradients in the null space of "
        "C.\n\n"
        "The reference is Newton's method on the whole saddle-point system with multipliers, dense, in numpy, with "
        "forces and stiffness from scikit-fem and an independent implementation of contact with the ball. Without "
        "point handles C is empty: the solution is then the fully resolved equilibrium of the body on its base. "
        "Differences are the largest over all nodes, relative to the largest displacement."
    ),
    sources=("J. Nocedal, S. J. Wright, Numerical Optimization, 2006, chapter 16 (KKT systems).",),
    run=run,
)
