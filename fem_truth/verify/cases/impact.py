"""A bar hits a rigid wall: St Venant's impact, and the momentum that backward Euler loses in it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from softprint.fem_truth.verify.case import Case, CaseResult, Curve, Line, Row
from softprint.fem_truth.verify.problems.motion import (
    FULL,
    REDUCED,
    exact_steps,
    mechanical_energy,
    moving,
    nodal,
    observed_order,
    play,
    simulator,
)
from softprint.fem_truth.verify.problems.small_bodies import DENSITY, Stuff, node_body
from softprint.runtime.arrays import Array
from softprint.runtime.colliders import KeyframedPath, Plane, RigidPose
from softprint.runtime.contact import PenaltyContact
from softprint.runtime.dynamics import PlacedCollider
from softprint.runtime.mesh import box_mesh

_YOUNG, _LENGTH, _WIDTH, _VELOCITY = 1e5, 0.1, 0.005, 0.1
_SOUND = float(np.sqrt(_YOUNG / DENSITY))
_PLATEAU = DENSITY * _SOUND * _VELOCITY * _WIDTH  # N per metre of thickness
_CONTACT_TIME = 2 * _LENGTH / _SOUND
# The penetration is sqrt(rho c v/k) = 1 micrometre, while the bar moves by 2 mm during contact.
_WALL = PenaltyContact(1e15)


@dataclass(frozen=True)
class Impact:
    """time (n,) [s] at the ends of the steps; force (n,) [N] on the bar; momentum (n + 1,) [kg m/s]; energy (n + 1,)
    [J]; time_step [s]."""

    time: Array
    force: Array
    momentum: Array
    energy: Array
    time_step: float


def _fly(name: str, cells: int) -> Impact:
    """Simulate the impact; sound travels one cell in two steps."""
    mesh = box_mesh([0.0, 0.0], [_LENGTH, _WIDTH], [cells, 1])
    body = node_body(mesh, Stuff("stable_neo_hookean", _YOUNG, 0.0))
    wall = PlacedCollider("wall", Plane([1.0, 0.0], "wall"), KeyframedPath.constant(RigidPose.identity(2)))
    h = 0.5 * _LENGTH / cells / _SOUND
    model = simulator(name, body, exact_steps(h, 1e-6), [wall], contact=_WALL)
    velocity = np.zeros_like(mesh.points)
    velocity[:, 0] = -_VELOCITY
    force, momentum = [], [-_VELOCITY * float(body.node_mass.sum())]
    energy = [-0.5 * _VELOCITY * momentum[0]]
    for result in play(model, moving(model, mesh.points, velocity), int(1.3 * _CONTACT_TIME / h)):
        _, v = nodal(model, result.state)
        force.append(-float(result.contacts["wall"].force[0]))
        momentum.append(float(body.node_mass @ v[:, 0]))
        energy.append(mechanical_energy(result))
    time = h * np.arange(1, len(force) + 1)
    return Impact(time, np.array(force), np.array(momentum), np.array(energy), h)


def _deficit(impact: Impact) -> float:
    """The share of the impulse 2 m v that is missing."""
    return 1 - impact.time_step * float(impact.force.sum()) / (_PLATEAU * _CONTACT_TIME)


def _half_time(impact: Impact) -> float:
    """Time at which the force drops below half of the plateau [s]."""
    after = int(np.flatnonzero(impact.force < 0.5 * _PLATEAU)[0])
    high, low = impact.force[after - 1 : after + 1]
    return float(impact.time[after] - impact.time_step * (0.5 * _PLATEAU - low) / (high - low))


def _rows(name: str, impact: Impact) -> list[Row]:
    middle = np.abs(impact.time / _CONTACT_TIME - 0.5) < 0.25
    balance = np.diff(impact.momentum) - impact.time_step * impact.force
    front = float(np.sqrt(impact.time_step * _CONTACT_TIME))
    lost = float(np.sqrt(2 / np.pi * impact.time_step / _CONTACT_TIME))
    scale = abs(impact.momentum[0])
    return [
        Row(
            f"{name}: force of the wall",
            "N/m",
            _PLATEAU,
            "St Venant: rho c v A",
            float(impact.force[middle].mean()),
            0.002 * _PLATEAU,
            "a strain of v/c = 1 % bends the material's law; the average over half of the contact",
        ),
        Row(
            f"{name}: time at which half of it is left",
            "ms",
            1e3 * (_CONTACT_TIME - 0.6745 * front),
            "St Venant's 2 L/c, less 0.6745 sqrt(h 2 L/c) for the tail of the front",
            1e3 * _half_time(impact),
            1e3 * 0.15 * front,
            "leading order in h",
        ),
        Row(
            f"{name}: share of the impulse 2 m v that is missing",
            "",
            lost,
            "numerical diffusion of backward Euler: sqrt(2/pi h c/(2 L))",
            _deficit(impact),
            0.03 * lost,
            "leading order in h",
        ),
        Row(
            f"{name}: largest difference of impulse and momentum in a step",
            "",
            0.0,
            "m v_n+1 - m v_n = h F_n+1; share of m v",
            float(np.abs(balance).max() / scale),
            1e-7,
            "each step is solved to 1e-6 of forces that change m v by a hundredth",
        ),
        Row(
            f"{name}: largest growth of energy in a step",
            "",
            0.0,
            "no work is done; share of the energy at first",
            float(np.diff(impact.energy).max() / impact.energy[0]),
            1e-7,
            "each step is solved to 1e-6, the error of energy is its square; and round-off",
            relation="<=",
        ),
    ]


def run(quick: bool) -> CaseResult:
    counts = {FULL: [20, 40] if quick else [20, 40, 80, 160], REDUCED: [20] if quick else [20, 40]}
    rows: list[Row] = []
    finest: list[Line] = []
    for name, cells in counts.items():
        impacts = [_fly(name, n) for n in cells]
        rows += _rows(name, impacts[-1])
        finest.append(Line(name, 1e3 * impacts[-1].time, impacts[-1].force, "curve"))
        if name == FULL:
            steps, missing = (
                np.array([i.time_step for i in impacts]),
                np.array([_deficit(i) for i in impacts]),
            )
            order = observed_order(steps, missing)
    rows.append(
        Row(
            "full space: order of the missing impulse",
            "",
            0.5,
            "a method of order 1 at a jump: numerical diffusion over the width of the front",
            order,
            0.03,
            "the wall is a little soft",
            order,
        )
    )
    theory = Line(
        "St Venant",
        1e3 * _CONTACT_TIME * np.array([0, 0, 1, 1, 1.3]),
        _PLATEAU * np.array([0, 1, 1, 0, 0]),
        "reference",
    )
    force = Curve("Force of the wall", "time [ms]", "force [N/m]", (*finest, theory))
    fall = Curve(
        "Missing impulse",
        "h c / (2 L)",
        "share of 2 m v",
        (
            Line("full space", steps / _CONTACT_TIME, missing),
            Line(
                "sqrt(2/pi h c/(2 L))",
                steps / _CONTACT_TIME,
                np.sqrt(2 / np.pi * steps / _CONTACT_TIME),
                "reference",
            ),
        ),
        log=True,
    )
    return CaseResult(tuple(rows), (force, fall), _NOTES)


_NOTES = (
    "The energy lost in the impact is that of the fastest waves, which the time step does not resolve: "
    "the bar returns slower than it came, never faster."
)

CASE = Case(
    name="impact",
    title="A bar flies against a wall",
    statement=(
        "A bar of length L with nu = 0 hits a rigid wall at v = c/100, c = sqrt(E/rho). A front travels through it "
        "with the speed of sound and is reflected at the free end: the force of the wall is rho c v A for a time of 2 "
        "L/c, and the bar leaves as fast as it came (St Venant).\n\n"
        "Backward Euler damps a wave w as exp(-h w^2 t/2), which smears the front to a Gaussian of variance h t in "
        "time. The wall cannot pull, so the tail of the front that arrives before 2 L/c is missing in the impulse: "
        "int_0^inf erfc(s/sqrt(2 h t)) ds at t = 2 L/c, a share sqrt(2/pi h c/(2 L)) of 2 m v, and half of the force "
        "is left 0.6745 sqrt(h t) before. The case checks this "
        "number, the exact balance of impulse and momentum in every step, and that no step creates energy."
    ),
    sources=(
        "W. Goldsmith, Impact, 1960 (St Venant's solution for a bar on a rigid wall).",
        "R. J. LeVeque, Finite Volume Methods for Hyperbolic Problems, 2002, sec. 8.6 and 8.7 (modified equations, "
        "accuracy near jumps).",
    ),
    run=run,
)
