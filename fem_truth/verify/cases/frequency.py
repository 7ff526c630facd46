"""First natural frequencies of bars, measured from their motion: along the bar, and in bending."""

from __future__ import annotations

import numpy as np
from scipy.linalg import expm
from scipy.optimize import brentq

from softprint.fem_truth.verify.case import Case, CaseResult, Curve, Line, Row
from softprint.fem_truth.verify.cases.backward_euler import clamped_bar
from softprint.fem_truth.verify.problems.motion import (
    BOTH,
    FULL,
    exact_steps,
    moving,
    nodal,
    observed_order,
    oscillation,
    play,
    simulator,
)
from softprint.fem_truth.verify.problems.small_bodies import DENSITY, Stuff, held_handles, node_body
from softprint.runtime.arrays import Array
from softprint.runtime.mesh import box_mesh


def _along(name: str, quick: bool) -> tuple[list[Row], Line]:
    """A bar fixed at both ends, nu = 0: w = pi c/L; w_mesh = w (1 - (pi dx/L)^2/24 + ...) with lumped masses."""
    cells = np.array([4, 8] if quick else [4, 8, 16, 32])
    speed, length, exact = np.sqrt(1e4 / DENSITY), 0.1, 0.0
    found = []
    for n in cells:
        mode = clamped_bar("", name, [int(n), 2])
        exact = np.pi * speed / length
        step = 0.1 / exact
        motion = oscillation(mode.amplitudes(step, 60, 1e-7), step)
        found.append(motion.undamped)
    errors = np.abs(np.array(found) / exact - 1)
    order = observed_order(1 / cells, errors)
    phase = step * mode.frequency
    rows = [
        Row(
            f"{name}: frequency along the bar, {cells[-1]} cells",
            "rad/s",
            float(exact),
            "pi/L sqrt(E/rho)",
            motion.undamped,
            1.1 * float(exact) * (np.pi / cells[-1]) ** 2 / 24,
            "error of the lumped linear bar, (pi dx/L)^2/24",
            order,
        ),
        Row(
            f"{name}: order of that frequency",
            "",
            2.0,
            "linear elements, lumped masses",
            order,
            0.1,
            "the next order of the error shows on these meshes",
            order,
        ),
        Row(
            f"{name}: frequency of the motion itself, h w = {phase:.4f}",
            "rad/s",
            float(np.arctan(phase)) / step,
            "atan(h w)/h with w = 2 c/dx sin(pi dx/(2 L))",
            motion.seen,
            1e-5 * float(exact),
            "each step is solved to 1e-7",
        ),
        Row(
            f"{name}: its rate of decay",
            "1/s",
            0.5 * float(np.log1p(phase**2)) / step,
            "log(1 + h^2 w^2)/(2 h)",
            motion.decay,
            1e-5 * float(exact),
            "each step is solved to 1e-7",
        ),
    ]
    return rows, Line(f"{name}, along", 1 / cells, errors)


_YOUNG, _LENGTH, _THICKNESS = 1e5, 0.2, 0.02
_ROOT = 1.875104068711961  # the first root of cos b cosh b = -1


def _euler_bernoulli() -> float:
    """b^2 sqrt(E I/(rho A L^4)) [rad/s] of a cantilever."""
    return float(_ROOT**2 * np.sqrt(_YOUNG * _THICKNESS**2 / (12 * DENSITY * _LENGTH**4)))


def _timoshenko() -> float:
    """First root w [rad/s] of det T_22(L) = 0 for a cantilever, T = exp(A x) being the transfer matrix of

    y' = phi + Q/(k G A),  phi' = M/(E I),  M' = -Q - rho I w^2 phi,  Q' = -rho A w^2 y,

    with zero deflection and rotation at one end, zero moment and shear force at the other; k = 5/6 for nu = 0.
    """
    area, inertia = _THICKNESS, _THICKNESS**3 / 12
    shear = 5 / 6 * 0.5 * _YOUNG * area

    def free_end(w: float) -> float:
        system = np.zeros((4, 4))
        system[0, 1], system[0, 3], system[1, 2] = 1.0, 1 / shear, 1 / (_YOUNG * inertia)
        system[2, 3], system[2, 1], system[3, 0] = -1.0, -DENSITY * inertia * w**2, -DENSITY * area * w**2
        return float(np.linalg.det(expm(system * _LENGTH)[2:, 2:]))

    return float(brentq(free_end, 0.8 * _euler_bernoulli(), 1.02 * _euler_bernoulli(), xtol=1e-12))


def _cantilever_shape(points: Array) -> Array:
    """The first mode of Euler and Bernoulli, with cross-sections normal to the axis; 1 at the tip."""
    z = _ROOT * points[:, 0] / _LENGTH
    ratio = (np.cosh(_ROOT) + np.cos(_ROOT)) / (np.sinh(_ROOT) + np.sin(_ROOT))
    across = np.cosh(z) - np.cos(z) - ratio * (np.sinh(z) - np.sin(z))
    slope = (np.sinh(z) + np.sin(z) - ratio * (np.cosh(z) - np.cos(z))) * _ROOT / _LENGTH
    return 0.5 * np.column_stack([-points[:, 1] * slope, across])


def _bending_frequency(cells: int) -> float:
    """Frequency of a cantilever with this many cells across and ten times as many along, in full space."""
    half = _THICKNESS / 2
    mesh = box_mesh([0.0, -half], [_LENGTH, half], [10 * cells, cells])
    body = node_body(mesh, Stuff("linear", _YOUNG, 0.0))
    step = 0.2 / _timoshenko()
    model = simulator(FULL, body, exact_steps(step, 1e-5), kinematic=held_handles(body, [0.0]))
    shape = _cantilever_shape(mesh.points)
    state = moving(model, mesh.points + 0.02 * _LENGTH * shape, np.zeros_like(shape))
    weight = body.node_mass[:, None] * shape
    amplitudes = [
        float(np.vdot(weight, nodal(model, result.state)[0] - mesh.points))
        for result in play(model, state, 40)
    ]
    # The second mode, 6.3 times as fast, loses a third of its amplitude per step: it vanishes within fifteen.
    return oscillation(np.array(amplitudes[15:]), step).undamped


def _bending(quick: bool) -> tuple[list[Row], list[Line]]:
    exact, classic = _timoshenko(), _euler_bernoulli()
    cells = np.array([2, 4] if quick else [4, 8, 12])
    found = np.array([_bending_frequency(int(n)) for n in cells])
    sizes = 1 / cells
    share = sizes[-1] ** 2 / (sizes[-2] ** 2 - sizes[-1] ** 2)
    limit = float(found[-1] + share * (found[-1] - found[-2]))
    errors = np.abs(found / exact - 1)
    order = observed_order(sizes, errors)
    coarse = 0.02 if quick else 0.003
    rows = [
        Row(
            "bending, extrapolated to fine meshes",
            "rad/s",
            exact,
            "Timoshenko's beam, k = 5/6; root of its transfer matrix",
            limit,
            coarse * exact,
            "linear triangles lock in bending, with an error of order 2 that is not quite regular yet",
            order,
        ),
        Row(
            "the same, against thin beams",
            "rad/s",
            classic,
            "Euler and Bernoulli: 1.8751^2 sqrt(E I/(rho A L^4))",
            limit,
            (0.007 + coarse) * classic,
            "shear and rotary inertia lower it by 0.65 % at L = 10 t",
        ),
        Row(
            "order of the frequency in bending",
            "",
            2.0,
            "linear elements",
            order,
            0.3 if quick else 0.1,
            "the next order of the error shows on these meshes",
            order,
        ),
    ]
    return rows, [Line("full space, bending", sizes / 10, errors)]


def run(quick: bool) -> CaseResult:
    rows, lines = [], []
    for name in BOTH:
        found, line = _along(name, quick)
        rows += found
        lines.append(line)
    bending, more = _bending(quick)
    errors = Curve("Error of the first frequency", "dx / L", "relative error", (*lines, *more), log=True)
    return CaseResult((*rows, *bending), (errors,), _NOTES)


_NOTES = (
    "Linear simplices are least accurate in bending: with four cells across, the beam is 21 % too stiff, which "
    "makes it 10 % too fast. The rows show that this is a discretisation error, of order 2, and no other."
)

CASE = Case(
    name="frequency",
    title="Natural frequencies of bars",
    statement=(
        "A bar is released in the shape of its first mode, and the frequency is measured by Prony's method: "
        "the roots of a_n+1 = p a_n - q a_n-1, fitted to the amplitudes. Backward Euler moves and damps a mode "
        "w: the motion has the frequency atan(h w)/h and decays at the rate log(1 + h^2 w^2)/(2 h), so that w = "
        "tan(h w_seen)/h is that of the body itself.\n\n"
        "Along a bar fixed at both ends, nu = 0, w = pi/L sqrt(E/rho). A cantilever, ten times as long as thick, in "
        "plane strain with nu = 0, bends at the frequency of Timoshenko's beam. It starts in the first mode of the "
        "thin beam; other modes in that shape are damped out before the measurement begins."
    ),
    sources=(
        "S. P. Timoshenko, On the correction for shear of the differential equation for transverse vibrations of "
        "prismatic bars, Philosophical Magazine 41, 1921.",
        "G. R. Cowper, The shear coefficient in Timoshenko's beam theory, Journal of Applied Mechanics 33, 1966 "
        "(10 (1 + nu)/(12 + 11 nu), which is 5/6 for nu = 0).",
        "T. J. R. Hughes, The Finite Element Method, 1987 (lumped linear bars).",
    ),
    run=run,
)
