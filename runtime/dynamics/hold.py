"""How a body is held: springs and kinematic handles, which may change from step to step at little cost.

A control loop that lets go of a handle, or takes another, gets another simulator by `held`: everything that is
expensive (contact, mechanics, corrections, cubature) is shared with the first one.
"""

from __future__ import annotations

import copy
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol, TypeVar

from softprint.runtime.body.body import ReducedBody
from softprint.runtime.dynamics.kinematic import KinematicHandle, free_dofs
from softprint.runtime.dynamics.settings import DynamicsSettings
from softprint.runtime.dynamics.step.step_energy import Unknowns
from softprint.runtime.dynamics.step.step_start import StepStart
from softprint.runtime.dynamics.terms.springs import HandleSpring, PointSpring, Springs, check_spring


@dataclass(frozen=True, eq=False)
class Hold:
    """The springs, the kinematic handles, and what of a step follows from them."""

    springs: Springs
    kinematic: tuple[KinematicHandle, ...]
    start: StepStart
    unknowns: Unknowns

    @classmethod
    def of(
        cls,
        body: ReducedBody,
        springs: Sequence[HandleSpring | PointSpring],
        kinematic: Sequence[KinematicHandle],
        time_step: float,
    ) -> Hold:
        """Raises SoftprintError for a handle that the body does not have, and for what is no spring of this body."""
        for spring in springs:
            check_spring(spring, body.handles)
        free = free_dofs(body.handles, kinematic)
        return cls(
            Springs(springs, body.handles),
            tuple(kinematic),
            StepStart(body, kinematic, time_step),
            Unknowns(body.handles, free, body.handles.units(0.5 * body.mesh.size)[free]),
        )


class Holdable(Protocol):
    """What a `Simulator` has."""

    body: ReducedBody
    settings: DynamicsSettings
    hold: Hold


Held = TypeVar("Held", bound=Holdable)


def held(
    simulator: Held,
    springs: Sequence[HandleSpring | PointSpring] = (),
    kinematic: Sequence[KinematicHandle] = (),
    settings: DynamicsSettings | None = None,
) -> Held:
    """The same simulator, held otherwise; settings: of its steps, the same by default. It steps the states of the first
    one, too; the factorisation and the elastic Hessian that they keep are used only if the same coordinates are
    free."""
    other = copy.copy(simulator)
    other.settings = settings or simulator.settings
    other.hold = Hold.of(simulator.body, springs, kinematic, other.settings.time_step)
    return other
