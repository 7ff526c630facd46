"""Energy never grows without external work: exact rates for a linear body, bounds for jelly and contact."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from softprint.fem_truth.verify.case import Case, CaseResult, Curve, Line, Row
from softprint.fem_truth.verify.cases.backward_euler import Mode, clamped_bar
from softprint.fem_truth.verify.problems.motion import (
    BOTH,
    FULL,
    AnySimulator,
    AnyState,
    exact_steps,
    mechanical_energy,
    moving,
    nodal,
    play,
    simulator,
)
from softprint.fem_truth.verify.problems.small_bodies import Stuff, held_handles, node_body, point_body
from softprint.runtime.colliders import KeyframedPath, Plane, RigidPose
from softprint.runtime.contact import CoulombFriction
from softprint.runtime.dynamics import PlacedCollider
from softprint.runtime.elasticity.elastic_energy import elastic_energy
from softprint.runtime.mesh import box_mesh

_GRAVITY, _STEP = 9.81, 0.002


def _decay_row(mode: Mode, steps: int) -> Row:
    """One mode: every step divides the energy by 1 + h^2 w^2."""
    turn = 0.1
    model, state = mode.let_go(turn / mode.frequency, 1e-8)
    start = model.step(state)
    energies = [mechanical_energy(result) for result in play(model, start.state, steps)]
    exact = (1 + turn**2) ** float(-steps)
    return Row(
        f"{mode.label}: energy of one mode left after {steps} steps",
        "",
        exact,
        "(1 + h^2 w^2)^-n with h w = 0.1",
        energies[-1] / mechanical_energy(start),
        1e-6 * exact,
        "each step is solved to 1e-8",
    )


def _shaken(name: str) -> tuple[AnySimulator, AnyState]:
    """A linear block fixed at one side, with a different velocity at every handle."""
    mesh = box_mesh([0.0, 0.0], [0.1, 0.05], [8, 4])
    stuff = Stuff("linear", 1e4, 0.3)
    body = node_body(mesh, stuff) if name == FULL else point_body(mesh, stuff, 8)
    held = held_handles(body, [0.0])
    model = simulator(name, body, exact_steps(_STEP, 1e-8), kinematic=held)
    velocity = 0.1 * np.random.default_rng(3).standard_normal(body.rest_rows.shape)
    velocity[[int(handle.handle) for handle in held]] = 0.0
    return model, moving(model, body.rest_rows, velocity)


def _balance_row(name: str, steps: int) -> Row:
    """A linear body loses exactly 1/2 |v_n+1 - v_n|_M^2 + 1/2 |x_n+1 - x_n|_K^2 in a step."""
    model, state = _shaken(name)
    body = model.body
    start = model.step(state)
    (x, v), energy = nodal(model, start.state), mechanical_energy(start)
    first, worst = energy, 0.0
    for result in play(model, start.state, steps):
        new_x, new_v = nodal(model, result.state)
        lost = 0.5 * body.node_mass @ ((new_v - v) ** 2).sum(axis=1)
        lost += elastic_energy(body.mesh, body.material, body.mesh.points + new_x - x)
        worst = max(worst, abs(energy - mechanical_energy(result) - lost) / first)
        x, v, energy = new_x, new_v, mechanical_energy(result)
    return Row(
        f"{name}: largest error of the energy balance of a step in {steps}",
        "",
        0.0,
        "a linear body loses 1/2 |dv|_M^2 + 1/2 |dx|_K^2 a step; share of the energy",
        float(worst),
        1e-8,
        "each step is solved to 1e-8",
    )


def _let_go(name: str, dim: int) -> tuple[AnySimulator, AnyState]:
    """A block of jelly fixed at one side, undeformed and at rest, which will bend under its weight."""
    mesh = box_mesh([0.0] * dim, [0.04, 0.02, 0.02][:dim], [6, 3, 3][:dim])
    stuff = Stuff("stable_neo_hookean", 4e3, 0.4)
    body = node_body(mesh, stuff) if name == FULL else point_body(mesh, stuff, 8)
    gravity, held = [0.0] * (dim - 1) + [-_GRAVITY], held_handles(body, [0.0])
    model = simulator(name, body, exact_steps(_STEP, 1e-6), gravity=gravity, kinematic=held)
    return model, model.rest_state()


def _thrown(name: str, dim: int, mu: float) -> tuple[AnySimulator, AnyState]:
    """A block of jelly thrown towards a floor, rotated and spinning."""
    mesh = box_mesh([0.0] * dim, [0.06, 0.03, 0.03][:dim], [6, 3, 3][:dim])
    body = point_body(mesh, Stuff("stable_neo_hookean", 2e4, 0.4), 8)
    floor = Plane([0.0] * (dim - 1) + [1.0], "floor")
    model = simulator(
        name,
        body,
        exact_steps(_STEP, 1e-6),
        [PlacedCollider("floor", floor, KeyframedPath.constant(RigidPose.identity(dim)))],
        friction=CoulombFriction(mu) if mu else None,
        gravity=[0.0] * (dim - 1) + [-_GRAVITY],
    )
    rows, velocity = body.rest_rows.copy(), np.zeros_like(body.rest_rows)
    rows[:, -1] += 0.002
    velocity[:, 0] = 0.3 + 5 * (rows[:, -1] - 0.017)
    velocity[:, -1] = -0.5 - 5 * (rows[:, 0] - 0.03)
    return model, moving(model, rows, velocity)


def _growth(label: str, motion: tuple[AnySimulator, AnyState], steps: int) -> tuple[Row, Line]:
    """Energies are relative to the largest kinetic energy."""
    results = list(play(*motion, steps))
    energy = np.array([mechanical_energy(result) for result in results])
    energy /= max(result.energies["kinetic"] for result in results)
    row = Row(
        f"{label}: largest growth of energy in one of {steps} steps",
        "",
        0.0,
        "T + W falls by at least 1/2 |dv|_M^2 where W is convex; share of the largest kinetic energy",
        float(np.diff(energy).max()),
        1e-7,
        "each step is solved to 1e-6, the error of energy is its square; and round-off",
        relation="<=",
    )
    return row, Line(label, _STEP * np.arange(1, steps + 1), energy - energy[-1], "curve")


def _motions(quick: bool) -> Iterator[tuple[str, tuple[AnySimulator, AnyState], int]]:
    for name in BOTH:
        for dim in (2,) if quick else (2, 3):
            label, steps = f"{name}, {dim}D", 40 if quick else 400 if dim == 2 else 200
            yield f"{label}: jelly let go", _let_go(name, dim), steps
            yield f"{label}: thrown on a rough floor", _thrown(name, dim, 0.5), steps
            if dim == 2 and not quick:
                yield f"{label}: thrown on a smooth floor", _thrown(name, dim, 0.0), steps


def run(quick: bool) -> CaseResult:
    rows = [_decay_row(clamped_bar(name, name, [16, 3]), 100) for name in BOTH]
    rows += [_balance_row(name, 50 if quick else 400) for name in BOTH]
    lines = []
    for label, motion, steps in _motions(quick):
        row, line = _growth(label, motion, steps)
        rows.append(row)
        if label.startswith(f"{FULL}, 2D"):
            lines.append(line)
    curve = Curve("Energy, less that at the end", "time [s]", "share of the largest kinetic", tuple(lines))
    return CaseResult(tuple(rows), (curve,))


CASE = Case(
    name="energy",
    title="Energy never grows by itself",
    statement=(
        "With a potential W that is convex between two states, W(x_n) >= W(x_n+1) + W'(x_n+1) (x_n - x_n+1); with the "
        "step M (v_n+1 - v_n)/h = -W'(x_n+1) this says that kinetic energy and W together fall by at least "
        "1/2 |v_n+1 - v_n|_M^2. Gravity and the contact of points with a plane are convex, elasticity is over the "
        "range of these motions, and friction only dissipates. So no step may create energy. This is measured over "
        "hundreds of steps of a swinging jelly, and of one that is thrown on a floor, rough or smooth.\n\n"
        "For a linear body the inequality is an equation: every step loses 1/2 |v_n+1 - v_n|_M^2 + "
        "1/2 |x_n+1 - x_n|_K^2; and for one mode of frequency w, energy is divided by 1 + h^2 w^2."
    ),
    sources=(
        "The inequality follows from the step, as written out above.",
        "E. Hairer, G. Wanner, Solving Ordinary Differential Equations II, 1996, sec. IV.12 (B-stability).",
    ),
    run=run,
)
