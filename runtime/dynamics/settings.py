"""Settings of the steps of a simulator, reduced or full."""

from __future__ import annotations

from dataclasses import dataclass, field
from math import inf
from numbers import Integral, Real

from softprint.runtime.errors import SoftprintError
from softprint.runtime.optimise import Newton, NewtonSettings, Optimiser


@dataclass(frozen=True)
class DynamicsSettings:
    """time_step h [s]; newton: for each step; friction_updates: how often a step renews the normal forces of friction,
    before the last ones are held so that its iterations can converge; optimiser: of each step, in place of Newton's
    method with the settings `newton`; not in full space."""

    time_step: float = 1.0 / 60.0
    newton: NewtonSettings = field(default_factory=NewtonSettings)
    friction_updates: int = 3
    optimiser: Optimiser | None = None

    def __post_init__(self) -> None:
        if not isinstance(self.time_step, Real) or not 0 < self.time_step < inf:
            raise SoftprintError(
                f"the time step must be a positive number of seconds, not {self.time_step!r}"
            )
        if not isinstance(self.friction_updates, Integral) or self.friction_updates < 1:
            raise SoftprintError(
                f"friction_updates must be a whole number, at least 1, not {self.friction_updates!r}"
            )

    @property
    def method(self) -> Optimiser:
        """The optimiser that minimises the energy of a step."""
        return self.optimiser or Newton(self.newton)
