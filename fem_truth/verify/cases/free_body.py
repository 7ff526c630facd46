"""A free body: its momenta under backward Euler, and free fall."""

from __future__ import annotations

import numpy as np

from softprint.fem_truth.verify.case import Case, CaseResult, Curve, Line, Row
from softprint.fem_truth.verify.problems.motion import (
    BOTH,
    FULL,
    AnySimulator,
    AnyState,
    angular_momentum,
    exact_steps,
    linear_momentum,
    moving,
    nodal,
    observed_order,
    play,
    simulator,
)
from softprint.fem_truth.verify.problems.small_bodies import Stuff, node_body, point_body, rigid_body
from softprint.runtime.arrays import Array
from softprint.runtime.mesh import Mesh, box_mesh

_JELLY = Stuff("stable_neo_hookean", 2e4, 0.4)
_DURATION = 0.1  # s
_STEP = 0.01  # s
_ROTATION = 0.2  # rad: rotation of the rotor in its first step
_GRAVITY = 9.81
_CASES = [(name, dim) for name in BOTH for dim in (2, 3)]


def _mesh(dim: int) -> Mesh:
    return box_mesh([-0.05] * dim, [0.05] + [0.0] * (dim - 1), [8, 4, 4][:dim])


def _tumbling(model: AnySimulator, stretch: float) -> AnyState:
    """Spinning, drifting and stretching at once, at this many body lengths per second."""
    rows = model.body.rest_rows
    velocity = 0.3 + np.zeros_like(rows)
    velocity[:, 0] += stretch * rows[:, 0] - 6 * rows[:, 1]
    velocity[:, 1] += 6 * rows[:, 0]
    if model.body.dim == 3:
        velocity[:, 2] += 12 * rows[:, 1]
        velocity[:, 1] -= 12 * rows[:, 2]
    return moving(model, rows, velocity)


class _Flight:
    """Largest relative errors of a flight: drift of linear momentum and of the discrete law of angular momentum; and
    the share of angular momentum lost at the end."""

    def __init__(self, name: str, dim: int, time_step: float, stretch: float) -> None:
        body = point_body(_mesh(dim), _JELLY, 6)
        model = simulator(name, body, exact_steps(time_step, 1e-9))
        state, mass = _tumbling(model, stretch), body.node_mass
        x, v = nodal(model, state)
        linear, angular = linear_momentum(mass, v), angular_momentum(mass, x, v)
        self.drift, self.law, self.spin = 0.0, 0.0, [1.0]
        for result in play(model, state, round(_DURATION / time_step)):
            before = v
            x, v = nodal(model, result.state)
            now, scale = angular_momentum(mass, x, v), np.linalg.norm(angular)
            off = np.linalg.norm(linear_momentum(mass, v) - linear) / np.linalg.norm(linear)
            self.drift = max(self.drift, float(off))
            law = np.linalg.norm(now - angular_momentum(mass, x, before)) / scale
            self.law = max(self.law, float(law))
            self.spin.append(float(now @ angular / scale**2))
        self.loss = float(np.linalg.norm(now - angular) / scale)


def _momentum_rows() -> list[Row]:
    rows = []
    for name, dim in _CASES:
        flight = _Flight(name, dim, _STEP, stretch=3.0)
        for quantity, source, ours in (
            (
                "largest change of linear momentum",
                "no force from outside; share of the momentum",
                flight.drift,
            ),
            (
                "largest |L_n+1 - sum x_n+1 x m v_n|",
                "rotational invariance of the energy at x_n+1; share of L",
                flight.law,
            ),
        ):
            reason = "every step is solved to 1e-9"
            rows.append(Row(f"{name}, {dim}D: {quantity}", "", 0.0, source, ours, 1e-9, reason))
    return rows


def _loss_rows(quick: bool) -> tuple[list[Row], Curve]:
    steps = _STEP / np.array([2, 4] if quick else [1, 2, 4, 8])
    rows, lines = [], []
    for name, dim in _CASES[:1] if quick else _CASES:
        losses = np.array([_Flight(name, dim, float(h), stretch=0.0).loss for h in steps])
        order = observed_order(steps, losses)
        rows.append(
            Row(
                f"{name}, {dim}D: order of what is lost of L in {_DURATION:g} s",
                "",
                1.0,
                "L_n+1 - L_n = h sum m v_n+1 x v_n, of order h^2 a step",
                order,
                0.1,
                "the next order of the loss shows at these step sizes",
                order,
            )
        )
        lines.append(Line(f"{name}, {dim}D", steps, losses))
    first = Line("order 1", steps, lines[0].y[-1] * steps / steps[-1], "reference")
    return rows, Curve("What is lost of L", "time step [s]", "share of L", (*lines, first), log=True)


def _rotation(angle: float, dim: int) -> Array:
    """A rotation in the plane, or about the space diagonal."""
    if dim == 2:
        return np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    axis = np.full(3, 3**-0.5)
    skew = np.cross(axis, np.eye(3)).T  # skew @ y = axis x y
    return np.eye(3) + np.sin(angle) * skew + (1 - np.cos(angle)) * (skew @ skew)


def _rotor_rows(quick: bool) -> list[Row]:
    """A cube spins about its centre, in 3D about its diagonal, which is a principal axis of the mesh too."""
    rows, steps = [], 10 if quick else 100
    angle = _ROTATION
    for _ in range(steps):
        angle = float(np.arctan2(np.sin(angle), 2 - np.cos(angle)))
    for name, dim in _CASES:
        mesh, stuff = box_mesh([-0.05] * dim, [0.05] * dim, [3] * dim), Stuff("stable_neo_hookean", 1e7, 0.4)
        back = _rotation(-_ROTATION, dim).T
        if name == FULL:
            body = node_body(mesh, stuff)
            before = body.rest_rows @ back
        else:
            body = rigid_body(mesh, stuff)
            before = np.vstack([back, np.zeros(dim)])
        model = simulator(name, body, exact_steps(_STEP, 1e-7))
        state = moving(model, body.rest_rows, (body.rest_rows - before) / _STEP)
        path = [nodal(model, result.state)[0] for result in play(model, state, steps)]
        tolerance, reason = 1e-7, "its subspace is one frame: exactly rigid"
        if name == FULL:
            tolerance, reason = 1e-4, "it is not quite rigid: its initial strain is rho w^2 a^2/E = 1e-4"
        rows.append(
            Row(
                f"{name}, {dim}D: rotation of a stiff spinning cube in step {steps}",
                "rad",
                angle,
                "tan(d_n+1) = sin(d_n)/(2 - cos(d_n)), from 0.2 rad on",
                _angle(path[-2], path[-1]),
                tolerance * angle,
                reason,
            )
        )
    return rows


def _falling_rows(quick: bool) -> list[Row]:
    rows, steps = [], 10 if quick else 50
    for name, dim in _CASES:
        body = point_body(_mesh(dim), _JELLY, 6)
        down = np.array([0.0] * (dim - 1) + [-_GRAVITY])
        model = simulator(name, body, exact_steps(_STEP, 1e-9), gravity=down)
        for result in play(model, model.rest_state(), steps):
            state = result.state
        x, v = nodal(model, state)
        mass, time = body.node_mass, steps * _STEP
        fall = float(mass @ (body.mesh.points - x)[:, -1] / mass.sum())
        exact = steps * (steps + 1) / 2 * _STEP**2 * _GRAVITY
        for quantity, unit, reference, source, ours in (
            (
                "momentum",
                "kg m/s",
                mass.sum() * _GRAVITY * time,
                "m g t",
                -float(linear_momentum(mass, v)[-1]),
            ),
            ("way", "m", exact, "n (n + 1)/2 h^2 g, which is g t^2/2 (1 + 1/n)", fall),
        ):
            rows.append(
                Row(
                    f"{name}, {dim}D: {quantity} after falling for {time:g} s",
                    unit,
                    float(reference),
                    source,
                    ours,
                    1e-8 * float(reference),
                    "every step is solved to 1e-9",
                )
            )
    return rows


def _angle(before: Array, after: Array) -> float:
    """The angle of the best-fit rotation from one to the other."""
    fit = np.linalg.lstsq(before, after, rcond=None)[0]
    left, _, right = np.linalg.svd(fit)
    cosine = (np.trace(left @ right) - (len(fit) - 2)) / 2
    return float(np.arccos(np.clip(cosine, -1, 1)))


def run(quick: bool) -> CaseResult:
    lost, curve = _loss_rows(quick)
    return CaseResult(
        (*_momentum_rows(), *lost, *_rotor_rows(quick), *_falling_rows(quick)), (curve,), _NOTES
    )


_NOTES = (
    "Backward Euler does not conserve angular momentum: for a rotation rate w it is dissipated at the rate h w^2, "
    "which these rows measure. Use a smaller step where this matters."
)

CASE = Case(
    name="free_body",
    title="Momenta of a free body, and free fall",
    statement=(
        "The body is free. A step of backward Euler is M (v_n+1 - v_n)/h = -W'(x_n+1), x_n+1 = x_n + h v_n+1. "
        "The elastic energy W is invariant to translations: the forces of a step add up to zero, and linear momentum "
        "is conserved exactly. W is also invariant to rotations, so that the moment of these forces at x_n+1 is zero: "
        "sum x_n+1 x m v_n+1 = sum x_n+1 x m v_n, exactly. The right side is not L_n but "
        "L_n + h sum m v_n+1 x v_n: angular momentum decays, by an amount of order h^2 per step, of order h in total. "
        "A rigid body that rotates by d_n in step n has L = I sin(d_n)/h, and the law above gives "
        "tan(d_n+1) = sin(d_n)/(2 - cos(d_n)): a stiff cube has to follow it.\n\n"
        "In free fall momentum is m g t exactly, and the distance after n steps is n (n + 1)/2 h^2 g."
    ),
    sources=(
        "The laws follow from the step and the invariance of the energy, as written out above.",
        "J. C. Simo, N. Tarnow, The discrete energy-momentum method, ZAMP 43, 1992 (what other schemes conserve).",
    ),
    run=run,
)
