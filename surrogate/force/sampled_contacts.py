"""Solved contacts at samples of a truth, with the derivatives of forces and energy by b.

Condensed contact gives an energy W~ that is linear in b where dents harden, and nearly so elsewhere
(`runtime/contact/learned_energy/`), and so are its forces on the handles, h~ = dW~/dq. Nothing that is solved depends
on b, so that derivatives by it are differences.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from softprint.runtime.arrays import Array, BoolArray, IntArray
from softprint.runtime.colliders.collider import Collider
from softprint.runtime.contact.condensed.contact_evaluation import ContactEvaluation
from softprint.runtime.contact.frame_points import FramePoints
from softprint.runtime.contact.learned_energy.hardened_contact import HardenedContact
from softprint.runtime.contact.learned_energy.learned_energy import LearnedEnergy
from softprint.runtime.contact.solver.solved_contact import SolvedContact
from softprint.runtime.dynamics.handle_forces import HandleCoordinates
from softprint.runtime.errors import SoftprintError
from softprint.runtime.learned.force.contact_state import ContactStateProbe
from softprint.runtime.truth.truth_file import TruthData

#: The kinds of residuals: forces on the handles, the force on the collider, and the energy.
LABELS = ("handles", "collider", "energy")
# Of b.
_STEP = 0.01


class TouchingSample(NamedTuple):
    """A row of the truth file, what is true and found there and its derivatives, see `Sampled`, and whether the
    collider presses a rigid frame."""

    sample: int
    columns: Mapping[str, tuple[Array, Array, Array]]
    on_frame: bool


@dataclass(frozen=True, eq=False)
class Sampled:
    """s samples, by kind: what is true, what is found, and its derivatives by b (s, n_k); contacts: (s,) each
    sample's contact in the truth; its depths share one; on_frames: (s,) whether the collider presses a rigid frame,
    whose force no energy of a dent has."""

    samples: IntArray
    contacts: IntArray
    truth: Mapping[str, Array]
    found: Mapping[str, Array]
    slopes: Mapping[str, Array]
    on_frames: BoolArray

    @classmethod
    def of(cls, touching: Sequence[TouchingSample], truth: TruthData, asked: int) -> Sampled:
        """From single samples of `asked` ones. Raises SoftprintError where there is none."""
        if not touching:
            raise SoftprintError(
                f"{truth.path}: in none of {asked} samples does the reduced body touch the collider"
            )
        of_truth, of_contact, slopes = (
            {kind: np.stack([one.columns[kind][k] for one in touching]) for kind in LABELS} for k in range(3)
        )
        samples = np.array([one.sample for one in touching])
        on_frames = np.array([one.on_frame for one in touching])
        return cls(samples, truth.samples["contact"][samples], of_truth, of_contact, slopes, on_frames)

    @classmethod
    def joined(cls, parts: Sequence[Sampled]) -> Sampled:
        """All samples of some parts, of which there is at least one."""
        of_truth, of_contact, slopes = (
            {kind: np.concatenate([getattr(part, name)[kind] for part in parts]) for kind in LABELS}
            for name in ("truth", "found", "slopes")
        )
        samples, contacts, on_frames = (
            np.concatenate([getattr(part, name) for part in parts])
            for name in ("samples", "contacts", "on_frames")
        )
        return cls(samples, contacts, of_truth, of_contact, slopes, on_frames)

    def among(self, samples: IntArray) -> Sampled:
        """Those of some samples."""
        which = np.isin(self.samples, samples)
        truth, found, slopes = (
            {kind: values[which] for kind, values in table.items()}
            for table in (self.truth, self.found, self.slopes)
        )
        return Sampled(self.samples[which], self.contacts[which], truth, found, slopes, self.on_frames[which])

    def errors(self, samples: IntArray) -> dict[str, float]:
        """See `EnergyErrors`, over some of the samples; 0 over none."""
        some, least = self.among(samples), np.finfo(np.float64).tiny
        return {
            kind: float(np.linalg.norm(some.found[kind] - true) / max(np.linalg.norm(true), least))
            for kind, true in some.truth.items()
        }

    @property
    def comparable(self) -> IntArray:
        """The samples that press no rigid frame, and in which the force on the collider is not off by more than half:
        there the truth is in another equilibrium."""
        true = self.truth["collider"]
        miss = np.linalg.norm(self.found["collider"] - true, axis=1)
        return self.samples[~self.on_frames & (miss <= 0.5 * np.linalg.norm(true, axis=1))]


class SampledContacts:
    """The contacts of samples of a truth, followed along their approach once and then from the last ones found.
    by_collider: the colliders of some samples, each with its own; contact_of: makes the contact of the body with a
    collider; handles: along which coordinates forces are compared; origins: (n_rows,) 1 for rows that are positions;
    frames: points of the rigid frames, None for a body without any."""

    def __init__(
        self,
        truth: TruthData,
        by_collider: Callable[[IntArray], Iterator[tuple[Collider, IntArray]]],
        contact_of: Callable[[Collider, LearnedEnergy], ContactStateProbe],
        handles: HandleCoordinates,
        origins: Array,
        frames: FramePoints | None,
    ) -> None:
        self._truth, self._by_collider, self._contact_of = truth, by_collider, contact_of
        self._handles, self._origins, self._frames = handles, origins, frames
        self._last: dict[int, SolvedContact] = {}

    def at(self, samples: IntArray, learned: LearnedEnergy, progress: Callable[[int], None]) -> Sampled:
        """Those of the samples in which the reduced body touches the collider."""
        return Sampled.of(self.touching(samples, learned, progress), self._truth, len(samples))

    def touching(
        self, samples: IntArray, learned: LearnedEnergy, progress: Callable[[int], None]
    ) -> list[TouchingSample]:
        """The same one by one, collider by collider."""
        truth, touching = self._truth, list[TouchingSample]()
        for collider, part in self._by_collider(samples):
            probe = self._contact_of(collider, learned)
            for sample in map(int, part):
                progress(1)
                rows = truth.states["rows"][truth.sample_state[sample]]
                solved = self._solved(probe, sample, rows)
                if solved is None or not len(solved.active):
                    continue
                found = probe.evaluation(solved)
                by_energy, by_force = by_fourth(found)
                h, true = found.gradient, truth.contact_handle_force(sample)
                columns = {
                    "handles": self._compared(rows, true, h, by_force),
                    "collider": self._summed(true, h, by_force),
                    "energy": (
                        np.array([truth.contact_energy(sample)]),
                        np.array([found.energy]),
                        np.array([by_energy]),
                    ),
                }
                at = rows, collider, truth.approach_path(sample)[-1]
                on_frame = self._frames is not None and self._frames.any_inside(*at)
                touching.append(TouchingSample(sample, columns, on_frame))
        return touching

    def n_states(self, samples: IntArray) -> int:
        """How many states samples (n,) are of."""
        return len(np.unique(self._truth.sample_state[samples]))

    def _compared(self, rows: Array, true: Array, found: Array, slopes: Array) -> tuple[Array, Array, Array]:
        """Along the coordinates of the handles."""
        true, found, slopes = (self._handles.along(rows, force) for force in (true, found, slopes))
        return true, found, slopes

    def _summed(self, true: Array, found: Array, slopes: Array) -> tuple[Array, Array, Array]:
        """The force on the body."""
        return self._origins @ true, self._origins @ found, self._origins @ slopes

    def _solved(self, probe: ContactStateProbe, sample: int, rows: Array) -> SolvedContact | None:
        poses, solved = self._truth.approach_path(sample), self._last.get(sample)
        for pose in poses if solved is None else poses[-1:]:
            solved = probe.solve(rows, pose, solved)
        if solved is not None:
            self._last[sample] = solved
        return solved


def by_fourth(found: ContactEvaluation) -> tuple[float, Array]:
    """dW~/db [J] and dh~/db (n_rows, dim) [N] of a contact with active points under an energy."""
    assert found.contact is not None
    assert found.dent is not None
    assert found.learned is not None
    learned = found.learned
    more = HardenedContact(found.contact, replace(learned, fourth=learned.fourth + _STEP), found.dent)
    return (more.energy - found.energy) / _STEP, (more.gradient - found.gradient) / _STEP
