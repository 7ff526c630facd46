"""The plan: every contact (state, place, rotation), in an order of which any first part is useful.

    for k in rotations, p in places, s in states:   contact (s, p, (a p + b s + k) mod n_rotations)

a Latin arrangement: every run of n_states contacts has each state once; every run of n_states * n_places has
each (state, place) once, with all rotations spread evenly over them (a, b coprime to n_rotations where it can
be). Places and rotations are in farthest-point order themselves, so a part of the first run is spread as well
as it can be.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from math import gcd

import numpy as np

# Streams of random numbers: each use of the seed has its own, so that none depends on how often another
# draws.
ROTATIONS_STREAM, DEPTHS_STREAM, REPEATS_STREAM, SIDEWAYS_STREAM, TURN_STREAM = 1, 2, 3, 4, 5

_GOLDEN = 0.5 * (5**0.5 - 1)


@dataclass(frozen=True)
class PlannedContact:
    """One contact; unit: its number in the order of work; place: index into the places; repeated: solved
    twice."""

    unit: int
    state: int
    place: int
    rotation: int
    repeated: bool


@dataclass(frozen=True)
class ContactPlan:
    """All contacts of an experiment. repeat_share: share of contacts solved twice, one drawn from each
    block."""

    n_states: int
    n_places: int
    n_rotations: int
    repeat_share: float
    seed: int

    def __len__(self) -> int:
        return self.n_states * self.n_places * self.n_rotations

    def __iter__(self) -> Iterator[PlannedContact]:
        return (self[unit] for unit in range(len(self)))

    def __getitem__(self, unit: int) -> PlannedContact:
        if not 0 <= unit < len(self):
            raise IndexError(unit)
        rest, state = divmod(unit, self.n_states)
        turn, place = divmod(rest, self.n_places)
        stride = _coprime_stride(self.n_rotations)
        rotation = (stride * place + stride**2 * state + turn) % self.n_rotations
        return PlannedContact(unit, state, place, rotation, self._repeated(unit))

    def rng(self, stream: int, contact: PlannedContact) -> np.random.Generator:
        """The generator of one contact: the same whichever rank solves it, and in whatever order."""
        return np.random.default_rng([self.seed, stream, contact.state, contact.place, contact.rotation])

    def rng_of_place(self, stream: int, contact: PlannedContact) -> np.random.Generator:
        """The generator of all contacts at one place of one state."""
        return np.random.default_rng([self.seed, stream, contact.state, contact.place])

    def _repeated(self, unit: int) -> bool:
        if self.repeat_share <= 0.0:
            return False
        block_size = max(1, round(1.0 / self.repeat_share))
        block, place_in_block = divmod(unit, block_size)
        size = min(block_size, len(self) - block * block_size)
        return place_in_block == np.random.default_rng([self.seed, REPEATS_STREAM, block]).integers(size)


def _coprime_stride(n: int) -> int:
    """The number coprime to n that is nearest to n times the golden section: multiples of it spread evenly
    mod n."""
    return min((k for k in range(1, n + 1) if gcd(k, n) == 1), key=lambda k: (abs(k - _GOLDEN * n), k))
