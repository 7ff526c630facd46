"""A common interface of both simulators, and quantities of a motion: momenta, energy, frequency."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np

from softprint.fem_truth.dynamics.full_space_simulator import FullSpaceSimulator
from softprint.fem_truth.dynamics.full_space_state import FullSpaceState
from softprint.fem_truth.elasticity.full_space_elasticity import FullSpaceElasticity
from softprint.runtime.arrays import Array
from softprint.runtime.body import ReducedBody
from softprint.runtime.contact import CoulombFriction, PenaltyContact
from softprint.runtime.dynamics import (
    DynamicsSettings,
    KinematicHandle,
    NewtonSettings,
    PlacedCollider,
    ReducedState,
    Simulator,
    StepResult,
)
from softprint.runtime.errors import SoftprintError

AnySimulator = FullSpaceSimulator | Simulator
AnyState = Any  # FullSpaceState or ReducedState, depending on the simulator

_PENALTY = PenaltyContact(1e9)

#: Names of the simulators in the rows of a case.
FULL, REDUCED = "full space", "reduced"
BOTH = (FULL, REDUCED)


def simulator(
    name: str,
    body: ReducedBody,
    settings: DynamicsSettings,
    colliders: Sequence[PlacedCollider] = (),
    *,
    contact: PenaltyContact = _PENALTY,
    friction: CoulombFriction | None = None,
    gravity: Sequence[float] | Array | None = None,
    kinematic: Sequence[KinematicHandle] = (),
) -> AnySimulator:
    """The simulator with this name; in full space the forms of a body are compiled once."""
    parts: dict[str, Any] = {
        "contact": contact,
        "friction": friction,
        "gravity": gravity,
        "kinematic": kinematic,
        "settings": settings,
    }
    if name == REDUCED:
        return Simulator(body, colliders, **parts)
    return FullSpaceSimulator(body, colliders, elasticity=_elasticity(body), **parts)


@lru_cache(maxsize=1)
def _elasticity(body: ReducedBody) -> FullSpaceElasticity:
    return FullSpaceElasticity(body)


def exact_steps(time_step: float, tolerance: float) -> DynamicsSettings:
    """Settings with steps of this length [s] that Newton's method solves to the tolerance, with more friction updates
    than by default."""
    return DynamicsSettings(time_step, NewtonSettings(100, tolerance), friction_updates=10)


def moving(model: AnySimulator, rows: Array, rows_velocity: Array) -> AnyState:
    """The state with these handle rows and their velocities (n_rows, dim); in full space that of U rows."""
    rest = model.rest_state()
    if isinstance(rest, FullSpaceState):
        basis = model.body.basis
        return replace(rest, x=basis @ rows, velocity=basis @ rows_velocity)
    return replace(rest, rows=rows, rows_velocity=rows_velocity)


def pushed(state: AnyState, velocity: Array) -> AnyState:
    """The state with a uniform velocity (dim,) [m/s]; for bodies without frames."""
    if isinstance(state, ReducedState):
        return replace(state, rows_velocity=np.tile(velocity, (len(state.rows), 1)))
    return replace(state, velocity=np.tile(velocity, (len(state.x), 1)))


def nodal(model: AnySimulator, state: AnyState) -> tuple[Array, Array]:
    """Positions x and velocities v of all nodes (n_nodes, dim) [m, m/s]."""
    if isinstance(state, ReducedState):
        basis = model.body.basis
        return basis @ state.rows, basis @ state.rows_velocity
    return state.x, state.velocity


def play(model: AnySimulator, state: AnyState, steps: int) -> Iterator[StepResult[Any]]:
    """The results of this many steps. Raises SoftprintError if one of them does not converge."""
    for number in range(steps):
        result = model.step(state)
        if not result.converged:
            raise SoftprintError(f"step {number + 1} of {steps} did not converge: {result.reason}")
        state = result.state
        yield result


def last(model: AnySimulator, state: AnyState, steps: int) -> tuple[Array, Array]:
    """`nodal` after this many steps."""
    for result in play(model, state, steps):
        state = result.state
    return nodal(model, state)


def linear_momentum(mass: Array, v: Array) -> Array:
    """sum_i m_i v_i (dim,) [kg m/s]."""
    return mass @ v


def angular_momentum(mass: Array, x: Array, v: Array) -> Array:
    """sum_i m_i x_i x v_i about the origin: (1,) in the plane, (3,) in space [kg m^2/s]."""
    if x.shape[1] == 2:
        return np.array([mass @ (x[:, 0] * v[:, 1] - x[:, 1] * v[:, 0])])
    return mass @ np.cross(x, v)


def mechanical_energy(result: StepResult[Any]) -> float:
    """Kinetic energy plus all potentials [J], which only external work can increase."""
    return sum(result.energies[name] for name in ("kinetic", "elastic", "gravity", "springs", "contact"))


@dataclass(frozen=True)
class Oscillation:
    """Frequencies and decay from the amplitudes of one mode under backward Euler.

    seen [rad/s]: the frequency of the motion itself; decay [1/s]: its rate of decay; undamped [rad/s]: that of the
    mode. Backward Euler multiplies modes of frequency w by 1/(1 - i h w) per step, so that

        seen = atan(h w)/h,    decay = log(1 + h^2 w^2)/(2 h),    w = tan(h seen)/h.
    """

    seen: float
    decay: float
    undamped: float


def oscillation(amplitudes: Array, time_step: float) -> Oscillation:
    """The oscillation of amplitudes (n,) at successive steps, by Prony's method: a least-squares fit of
    a_k+1 = p a_k - q a_k-1, whose roots are sqrt(q) exp(+-i h seen)."""
    a = amplitudes / np.abs(amplitudes).max()
    (p, q), *_ = np.linalg.lstsq(np.column_stack([a[1:-1], -a[:-2]]), a[2:], rcond=None)
    turn = float(np.arccos(0.5 * p / np.sqrt(q)))
    return Oscillation(turn / time_step, -0.5 * float(np.log(q)) / time_step, float(np.tan(turn)) / time_step)


def observed_order(sizes: Array, errors: Array) -> float:
    """log(e_1/e_2)/log(h_1/h_2) of the two smallest sizes h, which come last."""
    return float(np.log(errors[-2] / errors[-1]) / np.log(sizes[-2] / sizes[-1]))
