"""The plan: every contact (state, collider, place, rotation), in an order whose every prefix is a useful data set.

    for k in range(turns), p in places, c in colliders, s in states:
        contact (s, c, place p + d c mod n_places, rotation a p + b s + a b c + k mod n_rotations)

This is a Latin arrangement: every block of n_states contacts has each state once; every block of n_states * n_places
contacts of a collider has each (state, place) once, with all rotations spread evenly over them (a, b coprime to
n_rotations where possible). Places and rotations are themselves in farthest-point order, so a prefix of the first block
is spread as well as possible; colliders begin at different places. A collider may have fewer places than others.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from math import gcd

import numpy as np

# Random number streams: each use of the seed has its own, so that none depends on how many numbers another draws.
ROTATIONS_STREAM, DEPTHS_STREAM, REPEATS_STREAM, SIDEWAYS_STREAM, TURN_STREAM = 1, 2, 3, 4, 5
OTHER_TURNS_STREAM = 6

_GOLDEN = 0.5 * (5**0.5 - 1)


@dataclass(frozen=True)
class PlannedContact:
    """One contact; unit: its number in the order of work; collider: index into the colliders; place: index into the
    places; repeated: whether it is solved twice."""

    unit: int
    state: int
    collider: int
    place: int
    rotation: int
    repeated: bool


@dataclass(frozen=True)
class ContactPlan:
    """All contacts of an experiment.

    places: number of places of each collider; turns: number of contacts of a collider at each place, each with a
    different rotation; repeat_share: share of contacts solved twice, one drawn from each block.
    """

    n_states: int
    places: tuple[int, ...]
    n_rotations: int
    turns: int
    repeat_share: float
    seed: int

    @property
    def n_places(self) -> int:
        return max(self.places)

    @cached_property
    def _meetings(self) -> list[tuple[int, int]]:
        """(place, collider) of one turn, in the order of work."""
        return [
            (place, collider)
            for place in range(self.n_places)
            for collider, count in enumerate(self.places)
            if place < count
        ]

    def __len__(self) -> int:
        return self.n_states * len(self._meetings) * self.turns

    def __iter__(self) -> Iterator[PlannedContact]:
        return (self[unit] for unit in range(len(self)))

    def __getitem__(self, unit: int) -> PlannedContact:
        if not 0 <= unit < len(self):
            raise IndexError(unit)
        rest, state = divmod(unit, self.n_states)
        turn, meeting = divmod(rest, len(self._meetings))
        place, collider = self._meetings[meeting]
        stride = _coprime_stride(self.n_rotations)
        rotation = (stride * place + stride**2 * state + stride**3 * collider + turn) % self.n_rotations
        place = (place + _coprime_stride(self.n_places) * collider) % self.n_places
        return PlannedContact(unit, state, collider, place, rotation, self._repeated(unit))

    def rng(self, stream: int, contact: PlannedContact) -> np.random.Generator:
        """The generator of one contact: independent of the rank that solves it and of the order."""
        return np.random.default_rng(
            [self.seed, stream, self._setting(contact), contact.place, contact.rotation]
        )

    def rng_of_place(self, stream: int, contact: PlannedContact) -> np.random.Generator:
        """The generator of all contacts of a collider at one place of one state."""
        return np.random.default_rng([self.seed, stream, self._setting(contact), contact.place])

    def _setting(self, contact: PlannedContact) -> int:
        """A number for each pair of state and collider."""
        return contact.state + self.n_states * contact.collider

    def _repeated(self, unit: int) -> bool:
        if self.repeat_share <= 0.0:
            return False
        block_size = max(1, round(1.0 / self.repeat_share))
        block, place_in_block = divmod(unit, block_size)
        size = min(block_size, len(self) - block * block_size)
        return place_in_block == np.random.default_rng([self.seed, REPEATS_STREAM, block]).integers(size)


def _coprime_stride(n: int) -> int:
    """The number coprime to n that is nearest to n times the golden ratio conjugate: its multiples are spread evenly
    mod n."""
    return min((k for k in range(1, n + 1) if gcd(k, n) == 1), key=lambda k: (abs(k - _GOLDEN * n), k))
