"""Condensed contact, of mechanics and learned: an energy as in full space, and forces that are its derivatives."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from softprint.fem_truth.elasticity.full_space_elasticity import FullSpaceElasticity
from softprint.fem_truth.statics.constrained import ConstrainedProblem
from softprint.fem_truth.statics.newton import FullSpaceSettings
from softprint.fem_truth.verify.case import Case, CaseResult, Row
from softprint.runtime.arrays import Array
from softprint.runtime.body import ReducedBody, assemble_body, frame_in_box, place_handles
from softprint.runtime.colliders import RigidPose, Sphere
from softprint.runtime.colliders.pose import rotation_matrix
from softprint.runtime.contact import PenaltyContact
from softprint.runtime.contact.condensed.condensed_contact import CondensedContact
from softprint.runtime.contact.condensed.contact_evaluation import ContactEvaluation
from softprint.runtime.contact.learned_energy.learned_energy import LearnedEnergy
from softprint.runtime.elasticity.materials import make_material
from softprint.runtime.mechanics.body_mechanics import compute_mechanics
from softprint.runtime.mesh import box_mesh
from softprint.runtime.optimise import NewtonSettings

YOUNG, POISSON, DENSITY = 2e4, 0.4, 1000.0
# On facets, in reduced models with the points of full space.
LAW = PenaltyContact(1e9, refinement=2, reduced_refinement=2)
RADIUS, DEPTH, TOP = 0.015, 0.005, 0.05  # m
# A little more than what is learned on the small Jelly.
LEARNED = LearnedEnergy.of((0.4,))
_TIGHT = FullSpaceSettings(NewtonSettings(60, 1e-9), 1e-14, cg_tolerance_min=1e-8)
_STEP = 1e-6  # m, of differences
_SOLVES = (
    "contact is solved to 1e-5 of the depth with a compliance in single precision; differences over 1 um"
)


@dataclass(frozen=True)
class _Press:
    """Contact of a body with a ball at handle rows."""

    body: ReducedBody
    contact: CondensedContact
    rows: Array

    @classmethod
    def of(cls, body: ReducedBody, learned: LearnedEnergy | None) -> _Press:
        """With all surface nodes as contact nodes; rows: the handles displaced at random, by about 1 mm each."""
        mechanics = compute_mechanics(body, body.n_nodes, condensation=False)
        ball = Sphere(RADIUS, body.dim, "ball")
        contact = CondensedContact.of(body, mechanics, {"ball": ball}, LAW, learned=learned)
        rows = body.rest_rows.copy()
        count = body.handles.n_points
        rows[:count] += 1e-3 * np.random.default_rng(4).standard_normal((count, body.dim))
        return cls(body, contact, rows)

    def at(
        self, pose: RigidPose, rows: Array | None = None, near: ContactEvaluation | None = None
    ) -> ContactEvaluation:
        """At handle rows, those of the press by default, in their frame. near: the warm start."""
        rows = self.rows if rows is None else rows
        start = None if near is None else near.warm_start
        return self.contact.evaluate(self.contact.in_frame(rows), rows, {"ball": pose}, start)


def _body(dim: int, quick: bool, model: str = "stable_neo_hookean") -> ReducedBody:
    """A block on a rigid slab, with 5 point handles."""
    fine = {2: [20, 10], 3: [8, 8, 6]}[dim] if not quick else {2: [12, 6], 3: [5, 5, 4]}[dim]
    mesh = box_mesh([-TOP] * (dim - 1) + [0.0], [TOP] * dim, fine)
    slab = [[-1.0] * dim, [1.0] * (dim - 1) + [0.009]]
    handles = place_handles(mesh, 5, [frame_in_box(mesh, "base", slab)])
    return assemble_body(mesh, handles, make_material(model, YOUNG, POISSON), DENSITY)


def _pose(dim: int, aside: float = 0.0, depth: float = DEPTH) -> RigidPose:
    """The ball above the middle of the top, that deep in the top at rest."""
    return RigidPose(np.eye(dim), np.append(np.full(dim - 1, 0.003 + aside), TOP + RADIUS - depth))


def _full_space_rows(dim: int, quick: bool) -> list[Row]:
    """At rest and of a linear material, against the constrained solve in full space."""
    body, pose = _body(dim, quick, "linear"), _pose(dim)
    problem = ConstrainedProblem(FullSpaceElasticity(body), None, LAW, body)
    rest = body.mesh.points
    solution = problem.solve(body.rest_rows, Sphere(RADIUS, dim, "ball"), pose, rest, _TIGHT)
    press = _Press.of(body, None)
    found = press.at(pose, body.rest_rows)
    points = slice(body.handles.n_points)
    force = -found.forces()["ball"].force
    source = "full-space equilibrium of the linear material with the same handles"
    reason = "the compliance of all nodes is kept, in single precision"
    summed = solution.handle_force[points].sum(axis=0) + solution.handle_force[-1]
    return [
        Row(
            f"{dim}D, linear material: energy",
            "J",
            solution.energy,
            source,
            found.energy,
            1e-5 * abs(solution.energy),
            reason,
        ),
        Row(
            f"{dim}D, linear material: force on the body",
            "N",
            float(np.linalg.norm(summed)),
            source,
            float(np.linalg.norm(force)),
            1e-5 * float(np.linalg.norm(summed)),
            reason,
        ),
    ]


def _derivative_rows(label: str, press: _Press) -> list[Row]:
    """Gradient, Hessian, and the force on the ball."""
    dim, pose = press.body.dim, _pose(press.body.dim)
    here = press.at(pose)
    frame = press.contact.in_frame(press.rows)
    direction = np.random.default_rng(0).standard_normal(press.rows.shape)
    # At random alone it may be nearly across the gradient, along which nothing is seen of an error of its size.
    direction += here.gradient * (np.linalg.norm(direction) / np.linalg.norm(here.gradient))
    ahead, behind = (
        press.contact.evaluate(frame, press.rows + side * _STEP * direction, {"ball": pose}, here.warm_start)
        for side in (1, -1)
    )
    slope = (ahead.energy - behind.energy) / (2 * _STEP)
    bend = ((ahead.gradient - behind.gradient) / (2 * _STEP)).ravel()
    assert here.hessian is not None
    bent = here.hessian() @ direction.ravel()
    down = np.append(np.zeros(dim - 1), _STEP)
    above, below = (
        press.at(RigidPose(pose.rotation, pose.translation + side * down), near=here) for side in (1, -1)
    )
    push = -(above.energy - below.energy) / (2 * _STEP)
    force = here.forces()["ball"].force
    on_handles = press.body.handles.affine_part @ here.gradient
    size = float(np.linalg.norm(force))
    largest = float(np.linalg.norm(here.gradient) * np.linalg.norm(direction))
    return [
        Row(f"{label}: slope along the handles", "N", slope, "differences of the energy",
            float(np.vdot(here.gradient, direction)), 1e-5 * largest, _SOLVES),
        Row(f"{label}: error of the Hessian along the handles", "", 0.0, "differences of the gradient",
            float(np.linalg.norm(bent - bend) / np.linalg.norm(bend)), 1e-3, _SOLVES),
        Row(f"{label}: force on the ball", "N", push, "differences of the energy",
            float(force[-1]), 1e-4 * size, _SOLVES),
        Row(f"{label}: sum of the forces on handles and ball", "N", 0.0, "action and reaction",
            float(np.abs(on_handles - force).max()), 1e-6 * size, "sums in another order, modes in single precision"),
    ]  # fmt: skip


def _rigid_row(label: str, press: _Press) -> Row:
    """Body and ball moved together."""
    dim, pose = press.body.dim, _pose(press.body.dim)
    Q = rotation_matrix([0.7] if dim == 2 else [0.2, 0.7, -0.4], dim)
    shift = np.full(dim, 0.03)
    moved = press.rows @ Q.T + np.outer(press.body.handles.affine_part, shift)
    energy = press.at(pose).energy
    return Row(
        f"{label}: energy after a rotation of body and ball",
        "J",
        energy,
        "nothing depends on the axes of space",
        press.at(RigidPose(Q @ pose.rotation, Q @ pose.translation + shift), moved).energy,
        1e-5 * energy,
        "the compliance is in single precision, each contact solved to 1e-5 of the depth",
    )


def _path(dim: int, steps: int) -> list[RigidPose]:
    """Down, sideways, up, and back: a closed path of the ball, clear of the body at both ends."""
    corners = [(0.0, -0.002), (0.0, DEPTH), (0.012, 0.6 * DEPTH), (0.012, -0.002), (0.0, -0.002)]
    ways = []
    for (aside, depth), (then, deeper) in pairwise(corners):
        t = np.arange(steps) / steps
        ways += [(aside + s * (then - aside), depth + s * (deeper - depth)) for s in t]
    return [_pose(dim, *at) for at in [*ways, corners[-1]]]


def _work_row(label: str, press: _Press, steps: int) -> Row:
    """Work of the ball on a body with held handles along the path, by Simpson's rule."""
    poses = _path(press.body.dim, 2 * steps)
    forces, largest, near = [], 0.0, None
    for pose in poses:
        near = press.at(pose, near=near)
        forces.append(near.forces()["ball"].force)
        largest = max(largest, near.energy)
    f, x = np.array(forces), np.array([pose.translation for pose in poses])
    along = (x[2::2] - x[:-2:2]) / 6.0
    work = float(-((f[:-2:2] + 4.0 * f[1:-1:2] + f[2::2]) * along).sum())
    return Row(
        f"{label}: work of a press, a slide and a release without friction, share of the largest energy",
        "",
        0.0,
        "the energy is a function of the state: no closed path has work",
        work / largest,
        1e-4,
        "Simpson's rule over forces that are not smooth where points begin to bear",
    )


def run(quick: bool) -> CaseResult:
    rows = []
    for dim in (2,) if quick else (2, 3):
        rows += _full_space_rows(dim, quick)
        body = _body(dim, quick)
        for what, learned in (("mechanics", None), ("learned", LEARNED)):
            label, press = f"{dim}D, {what}", _Press.of(body, learned)
            rows += _derivative_rows(label, press)
            rows.append(_rigid_row(label, press))
            rows.append(_work_row(label, press, 30 if quick else 100))
    return CaseResult(tuple(rows))


CASE = Case(
    name="condensed_contact",
    title="Condensed contact: one energy, and its derivatives",
    statement=(
        "A ball is pressed into a block whose handles are held. Condensed contact gives the energy of contact and of "
        "the dent together as a function of the handle rows and of the pose of the ball, by linear mechanics of the "
        "body and with what is learned on top. For a linear material at rest it is the energy of full space with the "
        "same handles, and its force. At a strained state its gradient and Hessian are those of differences, the "
        "forces on handles and ball are equal and opposite, rotating all together changes nothing, and the ball does "
        "no work on a closed path: down, sideways, up and back."
    ),
    sources=(
        "The equations are in the documentation, under The method: Condensed contact, and The learned energy.",
    ),
    run=run,
)
