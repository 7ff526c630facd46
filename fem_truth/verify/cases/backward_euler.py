"""Backward Euler: its exact damping of one mode, and order 1 in the time step."""

from __future__ import annotations

import numpy as np
from scipy.integrate import solve_ivp

from softprint.fem_truth.verify.case import Case, CaseResult, Curve, Line, Row
from softprint.fem_truth.verify.problems.motion import (
    FULL,
    REDUCED,
    AnySimulator,
    AnyState,
    exact_steps,
    last,
    moving,
    nodal,
    observed_order,
    play,
    simulator,
)
from softprint.fem_truth.verify.problems.small_bodies import (
    DENSITY,
    Stuff,
    affine_body,
    held_handles,
    node_body,
    point_body,
)
from softprint.runtime.arrays import Array, IntArray
from softprint.runtime.body import ReducedBody
from softprint.runtime.elasticity.elastic_energy import elastic_gradient
from softprint.runtime.mesh import box_mesh

_YOUNG, _LENGTH, _CELLS = 1e4, 0.1, 16
_SPEED = np.sqrt(_YOUNG / DENSITY)  # speed of sound along a bar with nu = 0 [m/s]
_LINEAR = Stuff("linear", _YOUNG, 0.0)
_AMPLITUDE = 0.01 * _LENGTH


class Mode:
    """A body, one of its modes over its rows (n_rows, dim), its exact frequency [rad/s], and the fixed handles."""

    def __init__(self, label: str, name: str, body: ReducedBody, shape: Array, frequency: float) -> None:
        self.label, self.body, self.shape, self.frequency = label, body, shape, frequency
        self._name = name
        clamped = body.n_rows == body.n_nodes
        self._kinematic = held_handles(body, [0.0, _LENGTH]) if clamped else []

    def let_go(self, time_step: float, tolerance: float) -> tuple[AnySimulator, AnyState]:
        """The initial state: zero velocity, at an amplitude of 1 % of the bar's length."""
        settings = exact_steps(time_step, tolerance)
        model = simulator(self._name, self.body, settings, kinematic=self._kinematic)
        rows = self.body.rest_rows + _AMPLITUDE * self.shape
        return model, moving(model, rows, np.zeros_like(rows))

    def amplitudes(self, time_step: float, steps: int, tolerance: float) -> Array:
        """(steps + 1,) amplitudes after release, relative to the first."""
        model, state = self.let_go(time_step, tolerance)
        shape = self.body.basis @ self.shape
        mode = self.body.node_mass[:, None] * shape
        found = [1.0]
        for result in play(model, state, steps):
            x, _ = nodal(model, result.state)
            found.append(float(np.vdot(mode, x - self.body.mesh.points) / np.vdot(mode, shape)) / _AMPLITUDE)
        return np.array(found)


def clamped_bar(label: str, name: str, divisions: list[int]) -> Mode:
    """sin(pi x/L) of a bar fixed at both ends. With nu = 0 and lumped masses it is a mode of the mesh too, with
    w = 2 c/dx sin(pi dx/(2 L)), the dispersion relation of a chain of masses and springs."""
    mesh = box_mesh([0.0] * len(divisions), [_LENGTH, *[0.02] * (len(divisions) - 1)], divisions)
    shape = np.zeros_like(mesh.points)
    shape[:, 0] = np.sin(np.pi * mesh.points[:, 0] / _LENGTH)
    cell = _LENGTH / divisions[0]
    frequency = 2 * _SPEED / cell * np.sin(0.5 * np.pi * cell / _LENGTH)
    return Mode(label, name, node_body(mesh, _LINEAR), shape, float(frequency))


def breathing_block(label: str, dim: int, cells: int) -> Mode:
    """A cube (square) that can only be deformed affinely, stretched along its diagonal d: u = e (d . (X - X_centre)) d.

    w^2 = E V/sum_i m_i (d . (X_i - X_centre))^2 = 12 E/(rho L^2)/(1 + (dim + 1)/n^2): every simplex of the n^dim cubes
    has its corners at equal distances along d, which gives the sum over lumped masses.
    """
    body = affine_body(box_mesh([0.0] * dim, [_LENGTH] * dim, [cells] * dim), _LINEAR)
    along = (body.rest_rows - 0.5 * _LENGTH).sum(axis=1) / (0.5 * dim * _LENGTH)
    shape = np.repeat(along[:, None], dim, axis=1)
    frequency = np.sqrt(12 / (1 + (dim + 1) / cells**2)) * _SPEED / _LENGTH
    return Mode(label, REDUCED, body, shape, float(frequency))


def _modes() -> list[Mode]:
    return [
        clamped_bar("full space, triangles", FULL, [_CELLS, 3]),
        clamped_bar("full space, tetrahedra", FULL, [_CELLS, 2, 2]),
        clamped_bar("reduced, all nodes handles", REDUCED, [_CELLS, 3]),
        breathing_block("reduced, affine, triangles", 2, 4),
        breathing_block("reduced, affine, tetrahedra", 3, 3),
    ]


def _decayed(phase: float, steps: Array) -> Array:
    """Re (1 - i h w)^-n = (1 + h^2 w^2)^(-n/2) cos(n atan(h w)), with phase = h w."""
    return (1 + phase**2) ** (-steps / 2) * np.cos(steps * np.arctan(phase))


def _damping(modes: list[Mode], count: int) -> tuple[list[Row], Curve]:
    rows: list[Row] = []
    lines: list[Line] = []
    phase, steps = 0.1, np.arange(count + 1.0)
    exact = _decayed(phase, steps)
    for mode in modes:
        found = mode.amplitudes(phase / mode.frequency, count, 1e-8)
        worst = int(np.abs(found - exact).argmax())
        rows.append(
            Row(
                f"{mode.label}: amplitude where {count} steps are worst (step {worst})",
                "",
                float(exact[worst]),
                "(1 + h^2 w^2)^(-n/2) cos(n atan(h w)) with h w = 0.1",
                float(found[worst]),
                1e-7,
                "each step is solved to 1e-8",
            )
        )
        if not lines:
            lines = [Line(mode.label, steps[::4], found[::4], "dots")]
    lines += [
        Line("closed form", steps, exact, "curve"),
        Line("no damping", steps, np.cos(phase * steps), "reference"),
    ]
    return rows, Curve("One mode, h w = 0.1", "step", "amplitude", tuple(lines))


def _order_of_mode(modes: list[Mode], quick: bool) -> tuple[list[Row], list[Line]]:
    """Order of the error after one period, relative to cos(w t) = 1."""
    rows, lines = [], []
    counts = np.array([100, 200] if quick else [50, 100, 200, 400])
    for mode in modes:
        period = 2 * np.pi / mode.frequency
        errors = np.array([abs(1 - mode.amplitudes(period / n, int(n), 1e-6)[-1]) for n in counts])
        rows.append(_order_row(f"{mode.label}: order after one period", 1 / counts, errors, "cos(w t)"))
        lines.append(Line(mode.label, 1 / counts, errors))
    return rows, lines


def _order_row(quantity: str, sizes: Array, errors: Array, source: str) -> Row:
    order = observed_order(sizes, errors)
    return Row(
        quantity,
        "",
        1.0,
        f"backward Euler is of order 1; errors against {source}",
        order,
        0.1,
        "required; the next order of the error shows at these step sizes",
        order,
    )


_GRAVITY = np.array([0.0, -9.81])
_SWING = 0.06  # s


def _swing_reference(body: ReducedBody, held: IntArray) -> Array:
    """Final positions, by an eighth-order explicit Runge-Kutta method with a tolerance of 1e-10, of
    M rows'' = U^T (m g - dW/dx), with the rows `held` fixed."""
    free = np.setdiff1d(np.arange(body.n_rows), held)
    mass = body.reduced_mass[np.ix_(free, free)]
    shape = (len(free), body.dim)

    def rate(_: float, y: Array) -> Array:
        rows = body.rest_rows.copy()
        rows[free] = y[: y.size // 2].reshape(shape)
        x = body.basis @ rows
        force = body.node_mass[:, None] * _GRAVITY - elastic_gradient(body.mesh, body.material, x)
        acceleration = np.linalg.solve(mass, (body.basis.T @ force)[free])
        return np.concatenate([y[y.size // 2 :], acceleration.ravel()])

    start = np.concatenate([body.rest_rows[free].ravel(), np.zeros(free.size * body.dim)])
    solved = solve_ivp(rate, (0.0, _SWING), start, method="DOP853", rtol=1e-10, atol=1e-12)
    rows = body.rest_rows.copy()
    rows[free] = solved.y[: start.size // 2, -1].reshape(shape)
    return body.basis @ rows


def _order_of_swing(quick: bool) -> tuple[list[Row], list[Line]]:
    """A jelly fixed at one side and released: large strain, not a single mode. Errors in the mass norm."""
    rows, lines = [], []
    counts = np.array([80, 160] if quick else [20, 40, 80, 160, 320])
    mesh, stuff = box_mesh([0.0, 0.0], [0.04, 0.02], [4, 2]), Stuff("stable_neo_hookean", 2e3, 0.4)
    for name, body in ((FULL, node_body(mesh, stuff)), (REDUCED, point_body(mesh, stuff, 6))):
        held = np.flatnonzero(body.rest_rows[:, 0] == 0.0).astype(np.int64)
        exact = _swing_reference(body, held)
        travel = np.sqrt(body.node_mass @ ((exact - body.mesh.points) ** 2).sum(axis=1))
        errors = []
        for n in counts:
            settings, kinematic = exact_steps(_SWING / n, 1e-7), held_handles(body, [0.0])
            model = simulator(name, body, settings, gravity=_GRAVITY, kinematic=kinematic)
            x, _ = last(model, model.rest_state(), int(n))
            errors.append(np.sqrt(body.node_mass @ ((x - exact) ** 2).sum(axis=1)) / travel)
        source = "SciPy's DOP853 at a tolerance of 1e-10"
        rows.append(_order_row(f"{name}: order, jelly let go", 1 / counts, np.array(errors), source))
        lines.append(Line(f"jelly, {name}", 1 / counts, errors))
    return rows, lines


def run(quick: bool) -> CaseResult:
    modes = _modes()[:: 2 if quick else 1]
    damping, motion = _damping(modes, 80 if quick else 200)
    of_mode, mode_lines = _order_of_mode(modes[:1] if quick else modes, quick)
    of_swing, swing_lines = _order_of_swing(quick)
    lines = (*mode_lines[:1], *swing_lines)
    sizes = np.array(lines[0].x)
    first = Line("order 1", sizes, lines[0].y[-1] * sizes / sizes[-1], "reference")
    errors = Curve("Error at the end", "time step / duration", "relative error", (*lines, first), log=True)
    return CaseResult((*damping, *of_mode, *of_swing), (motion, errors))


CASE = Case(
    name="backward_euler",
    title="Backward Euler in time",
    statement=(
        "One mode of a linear body, of frequency w, is released from rest. Backward Euler multiplies its complex "
        "amplitude by 1/(1 - i h w) a step, so that after n steps of length h the amplitude is (1 + h^2 w^2)^(-n/2) "
        "cos(n atan(h w)), for any step size: all steps have to agree with it. The bodies are chosen so that w is "
        "known without any computation. A bar with nu = 0, fixed at both ends, moves as sin(pi x/L); with "
        "lumped masses this is a mode of the mesh as well, with w = 2 c/dx sin(pi dx/(2 L)). A cube that can only be "
        "deformed affinely, stretched along its diagonal, has w^2 = 12 E/(rho L^2)/(1 + (dim + 1)/n^2).\n\n"
        "Relative to cos(w t), the solution in continuous time, the error after one period decreases with order 1. The "
        "same holds for a block of stable Neo-Hookean jelly, fixed at one side and released under its weight (strains "
        "of about one half), whose reference motion is computed by an explicit Runge-Kutta method of eighth order."
    ),
    sources=(
        "E. Hairer, G. Wanner, Solving Ordinary Differential Equations II, 1996, sec. IV.3: 1/(1 - z).",
        "T. J. R. Hughes, The Finite Element Method, 1987 (dispersion of the lumped linear bar).",
        "SciPy's DOP853 (Dormand and Prince, Runge-Kutta of order 8).",
    ),
    run=run,
)
