"""A block on an incline: with Coulomb friction it sticks below the critical angle and slides above."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from softprint.fem_truth.verify.case import Case, CaseResult, Curve, Line, Row
from softprint.fem_truth.verify.problems.motion import (
    BOTH,
    AnySimulator,
    exact_steps,
    moving,
    nodal,
    play,
    pushed,
    simulator,
)
from softprint.fem_truth.verify.problems.small_bodies import Stuff, point_body
from softprint.runtime.arrays import Array
from softprint.runtime.body import ReducedBody
from softprint.runtime.colliders import KeyframedPath, Plane, RigidPose
from softprint.runtime.contact import CoulombFriction, PenaltyContact
from softprint.runtime.dynamics import PlacedCollider, StepResult
from softprint.runtime.mesh import box_mesh

_GRAVITY, _MU, _SLIP = 9.81, 0.3, 1e-3
_STEP = 0.002  # s
_CONTACT = PenaltyContact(1e11, refinement=0)
#: Downhill direction of the incline in 3D: not aligned with the mesh.
_HEADING = {2: np.array([1.0]), 3: np.array([0.8, 0.6])}


def _block(dim: int) -> ReducedBody:
    mesh = box_mesh(
        [0.0] * dim, [0.08, 0.03] if dim == 2 else [0.06, 0.06, 0.03], [8, 3] if dim == 2 else [3, 3, 2]
    )
    return point_body(mesh, Stuff("stable_neo_hookean", 1e6, 0.3), 8)


@dataclass(frozen=True)
class Slide:
    """Motion of the centre of mass: velocity (n,) [m/s] down the incline after every step, and sideways after the last;
    distance down the incline [m]. friction: at the end, as a share of the weight."""

    velocity: Array
    aside: float
    way: float
    friction: float


class Incline:
    """A block on an incline of any angle: the floor is horizontal, and gravity is tilted."""

    def __init__(self, name: str, dim: int) -> None:
        self.label, self._name, self.dim, self._body = f"{name}, {dim}D", name, dim, _block(dim)
        self._down, self._along = np.append(np.zeros(dim - 1), -1.0), np.append(_HEADING[dim], 0.0)

    def _simulator(self, gravity: Array, friction: CoulombFriction | None) -> AnySimulator:
        floor = Plane(-self._down, "floor")
        placed = PlacedCollider("floor", floor, KeyframedPath.constant(RigidPose.identity(self.dim)))
        settings = exact_steps(_STEP, 1e-7)
        return simulator(
            self._name, self._body, settings, [placed], contact=_CONTACT, friction=friction, gravity=gravity
        )

    def slide(self, angle: float, steps: int, start: float = 0.0) -> Slide:
        """The block is in equilibrium on the floor; then slope and friction are switched on, and it starts with the
        velocity `start` [m/s]."""
        weight, slope = _GRAVITY * np.cos(angle) * self._down, _GRAVITY * np.sin(angle) * self._along
        pressed, rows = self._simulator(weight, None), self._body.rest_rows
        standing: StepResult[Any] = pressed.settle(
            moving(pressed, rows + 1e-4 * self._down, np.zeros_like(rows))
        )
        model = self._simulator(weight + slope, CoulombFriction(_MU, _SLIP))
        state, mass = pushed(standing.state, start * self._along), self._body.node_mass
        share = mass / mass.sum()
        places, velocities = [share @ nodal(model, state)[0]], []
        for result in play(model, state, steps):
            x, v = nodal(model, result.state)
            places.append(share @ x)
            velocities.append(share @ v)
        force = result.contacts["floor"].force
        aside = velocities[-1][:-1] - (velocities[-1] @ self._along) * self._along[:-1]
        return Slide(
            velocity=np.array(velocities) @ self._along,
            aside=float(np.linalg.norm(aside)),
            way=float((places[-1] - places[0]) @ self._along),
            friction=float(force @ self._along / (mass.sum() * _GRAVITY)),
        )


def _stick_rows(label: str, ratio: float, slide: Slide) -> list[Row]:
    angle = np.arctan(ratio * _MU)
    creep = _SLIP * (1 - np.sqrt(1 - ratio))
    return [
        Row(
            f"{label}: creep at tan a = {ratio:g} mu",
            "mm/s",
            1e3 * creep,
            "2 y - y^2 = tan(a)/mu with y = v/v_slip",
            1e3 * float(slide.velocity[-1]),
            1e-3 * 1e3 * _SLIP,
            "not quite steady yet: a thousandth of the slip velocity",
        ),
        Row(
            f"{label}: friction at tan a = {ratio:g} mu",
            "m g",
            float(np.sin(angle)),
            "balance of forces: sin a",
            slide.friction,
            1e-4,
            "not quite steady yet",
        ),
    ]


def _slide_rows(label: str, ratio: float, slide: Slide) -> list[Row]:
    angle = np.arctan(ratio * _MU)
    half = len(slide.velocity) // 2
    gain = slide.velocity[-1] - slide.velocity[-1 - half]
    return [
        Row(
            f"{label}: acceleration at tan a = {ratio:g} mu",
            "m/s^2",
            _GRAVITY * float(np.sin(angle) - _MU * np.cos(angle)),
            "g (sin a - mu cos a)",
            float(gain) / (half * _STEP),
            1e-5 * _GRAVITY,
            "1e-5 g: the block still oscillates a little, and normal forces are lagged",
        ),
        Row(
            f"{label}: friction at tan a = {ratio:g} mu",
            "m g",
            _MU * float(np.cos(angle)),
            "Coulomb: mu cos a",
            slide.friction,
            1e-5,
            "the block still oscillates a little",
        ),
    ]


def _stop_row(incline: Incline, steps: int) -> Row:
    start = 0.2
    exact = start**2 / (2 * _MU * _GRAVITY) - 0.5 * _STEP * start
    return Row(
        f"{incline.label}: stopping distance from {start:g} m/s on the flat",
        "mm",
        1e3 * exact,
        "v^2/(2 mu g), less h v/2: backward Euler has v_n = v - n h mu g",
        1e3 * incline.slide(0.0, steps, start).way,
        2e-3 * 1e3 * exact,
        "0.2 %: it bends as it is braked",
    )


def _aside_row(label: str, slide: Slide) -> Row:
    return Row(
        f"{label}: sideways velocity, as a share",
        "",
        0.0,
        "friction opposes the motion, whatever its direction",
        slide.aside / float(slide.velocity[-1]),
        1e-5,
        "the cut of the mesh into tetrahedra is not symmetric",
    )


def run(quick: bool) -> CaseResult:
    rows: list[Row] = []
    lines: list[Line] = []
    for name in BOTH:
        for dim in (2,) if quick else (2, 3):
            incline = Incline(name, dim)
            for ratio in (0.5, 2.0) if quick or dim == 3 else (0.5, 0.9, 1.1, 2.0):
                slide = incline.slide(float(np.arctan(ratio * _MU)), 30 if quick or dim == 3 else 50)
                rows += (_stick_rows if ratio < 1 else _slide_rows)(incline.label, ratio, slide)
                if dim == 2:
                    time = _STEP * np.arange(1, len(slide.velocity) + 1)
                    lines.append(Line(f"{name}, tan a = {ratio:g} mu", time, slide.velocity, "curve"))
            if dim == 3:
                rows.append(_aside_row(incline.label, slide))
            elif not quick:
                rows.append(_stop_row(incline, steps=45))
    return CaseResult(
        tuple(rows), (Curve("Down the incline", "time [s]", "velocity [m/s]", tuple(lines)),), _NOTES
    )


_NOTES = (
    "Sticking bodies creep, at a known velocity below the slip velocity of 1 mm/s: make that smaller where the creep "
    "matters."
)

CASE = Case(
    name="incline",
    title="Friction: a block on an incline",
    statement=(
        "A stiff block of jelly stands on an incline of angle a, with mu = 0.3. Above the critical angle, tan a = mu, "
        "it slides with the acceleration g (sin a - mu cos a). Below it sticks; but Coulomb's law is smoothed, as in "
        "IPC: at velocity v the friction on a point is only the share 2 y - y^2 of mu N, y = v/v_slip < 1. So it "
        "creeps, and balance of forces gives v = v_slip (1 - sqrt(1 - tan(a)/mu)). Both results are checked, on either "
        "side of the critical angle, and the friction force on the floor has to be m g sin a below and mu m g cos a "
        "above. In 3D the downhill direction is not aligned with the mesh: the block must not drift sideways. On the "
        "flat, with the initial velocity v, it has to stop after v^2/(2 mu g)."
    ),
    sources=(
        "Coulomb's law, and balance of forces.",
        "M. Li et al., Incremental Potential Contact, ACM Transactions on Graphics 39(4), 2020, eq. 14.",
    ),
    run=run,
)
