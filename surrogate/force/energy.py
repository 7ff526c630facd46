"""Learns the energy of contact (`runtime/contact/learned_energy/`) from the energies and forces of a truth.

A sample of the truth has the energy W_true that contact adds, and the generalised contact force h_true = dW_true/dq on
the handles, which are free: h_true is the Lagrange multiplier of the constraint. The parameter b of condensed contact
(`sampled_contacts.py`) is found by Gauss-Newton iterations on

    sum_i sum_k w_ik |r_ik|^2 / <|true_k|^2>

over samples i and three kinds of residual k: h~ - h_true along the coordinates of the handles, its sum, which is the
force on the collider, and W~ - W_true. So strong contacts count most: they move bodies, and where forces are weak,
linear mechanics with few contact points errs in ways that no b changes (docs/results_bodies.md, the small Ball).
Samples in which the collider presses a rigid frame as well are left out: a frame bears by itself
(`runtime/dynamics/terms/frame_contact.py`). w_ik takes weight from what no b fits (Huber 1964), as where the truth is
in another equilibrium.

The energy is kept where cross-validation bears it out: with the b that samples of other states and shapes give, by one
more iteration, it leaves significantly less error than linear mechanics (`energy_gain.py`).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np

from softprint.runtime.arrays import IntArray
from softprint.runtime.colliders.collider import Collider
from softprint.runtime.contact.frame_points import FramePoints
from softprint.runtime.contact.learned_energy.learned_energy import LEAST, MOST, LearnedEnergy
from softprint.runtime.dynamics.handle_forces import HandleCoordinates
from softprint.runtime.learned.force.contact_state import ContactStateProbe
from softprint.runtime.scenes.scene import held_frames
from softprint.runtime.truth.shared_samples import workers_for
from softprint.surrogate.data.folds import Fold, folds_of
from softprint.surrogate.data.training_data import TrainingData
from softprint.surrogate.force.energy_gain import gain_of
from softprint.surrogate.force.sampled_contacts import LABELS, Sampled, SampledContacts
from softprint.surrogate.force.shared_contacts import SharedContacts

# At most so many iterations, from this b, of which most bodies are not far. They have converged where another one would
# change b by less than this share.
ITERATIONS = 8
_START = 0.3
_CONVERGED = 1e-2
# Samples to learn from: one number is learned.
SAMPLES = 600
# Of the median residual, that from which on a sample loses weight.
_HUBER = 2.0
# The ridge on b, relative to the sum of the squares of the derivatives.
_RIDGE = 1e-3
_TINY = 1e-300


ContactMaker = Callable[[Collider, LearnedEnergy], ContactStateProbe]


class EnergyErrors(NamedTuple):
    """Errors of W and h by kind, sqrt(sum |r_k|^2 / sum |true_k|^2) over the samples of all folds that are
    `comparable`. mechanics: of linear mechanics; learned: of what was learned without the state and the shape of each;
    samples: their number; converged: whether the iterations have."""

    mechanics: dict[str, float]
    learned: dict[str, float]
    samples: int
    converged: bool = True


class Contacts(Protocol):
    """Contacts of samples: `SampledContacts`, or shared out among the cores."""

    def at(self, samples: IntArray, learned: LearnedEnergy, progress: Callable[[int], None]) -> Sampled: ...


def learn_energy(
    contacts: Contacts,
    samples: IntArray,
    folds: Sequence[Fold],
    progress: Callable[[int], None],
    labels: tuple[str, ...] = LABELS,
) -> tuple[LearnedEnergy | None, EnergyErrors]:
    """The energy from samples (n,), and its errors by cross-validation; None where it is not significantly better than
    linear mechanics, or where all samples press a rigid frame. folds: positions of samples; labels: the kinds of
    residuals to learn from."""
    before = contacts.at(samples, LearnedEnergy.of_mechanics(), progress)
    bearing = before.samples[~before.on_frames]
    parts = [
        _Part(*(np.intersect1d(samples[of], bearing) for of in (fold.learn, fold.judge))) for fold in folds
    ]
    parts = [part for part in parts if len(part.learn) and len(part.judge)]
    if not parts:
        nothing = dict.fromkeys(LABELS, 0.0)
        return None, EnergyErrors(nothing, nothing, 0)
    fit = _Fit(labels)
    learned, found, converged = fit.run(contacts, bearing, progress)
    by_others = [fit.iteration(found.among(part.learn), learned) for part in parts]
    judged = Sampled.joined(
        [contacts.at(part.judge, own, progress) for part, own in zip(parts, by_others, strict=True)]
    )
    compared = np.intersect1d(before.comparable, judged.samples)
    errors = EnergyErrors(before.errors(compared), judged.errors(compared), len(compared), converged)
    gain = gain_of(judged, before, compared, labels)
    return (learned, errors) if gain.significant else (None, errors._replace(learned=errors.mechanics))


def with_forces(data: TrainingData, samples: IntArray) -> IntArray:
    """Those of samples (n,) whose truth has forces on the handles."""
    known = np.isfinite(data.truth.samples["handle_force"][samples]).all(axis=(1, 2))
    return np.asarray(samples[known])


def contacts_of(data: TrainingData, contact_of: ContactMaker) -> SampledContacts:
    """The contacts of the samples of training data."""
    body = data.body
    handles = HandleCoordinates(body, held_frames(data.context.experiment))
    frames = FramePoints.of(body, body.mesh.surface_spacing) if body.handles.frames else None
    return SampledContacts(
        data.truth, data.by_collider, contact_of, handles, body.handles.affine_part, frames
    )


def energy_of(
    data: TrainingData, contact_of: ContactMaker
) -> tuple[LearnedEnergy | None, EnergyErrors] | None:
    """The energy that training data ask for, and its errors by cross-validation; None where the truth has no forces.
    contact_of: makes the contact of the body with a collider."""
    samples = drawn(with_forces(data, data.split.whole), data.context.seed)
    if not len(samples):
        return None
    contacts, folds = contacts_of(data, contact_of), folds_of(data.truth, samples, data.context.seed)
    total = (1 + ITERATIONS) * len(samples) + sum(len(fold.judge) for fold in folds)
    data.build_colliders(samples)
    with (
        data.context.progress(total, "sample", "learning the energy of contact") as bar,
        SharedContacts(contacts, data.truth, workers_for(data.truth, samples)) as shared,
    ):
        learned, errors = learn_energy(shared, samples, folds, bar.update)
    data.context.say(told(learned, errors, contacts.n_states(samples)))
    return learned, errors


def told(learned: LearnedEnergy | None, errors: EnergyErrors, n_states: int) -> str:
    """What training says of an energy from samples of so many states."""
    what = "learned"
    if n_states == 1:
        what += " from one state, and not known to hold where the body is strained otherwise"
    if not errors.converged:
        what += f", not converged in {ITERATIONS} iterations"
    if learned is None:
        what = "that of linear mechanics, than which nothing learned is significantly better"
    kinds = (f"{kind} {errors.mechanics[kind]:.1%} -> {errors.learned[kind]:.1%}" for kind in LABELS)
    return f"energy of contact: {what}; errors on held-out samples: {', '.join(kinds)}"


def drawn(samples: IntArray, seed: int, most: int = SAMPLES) -> IntArray:
    """At most so many of samples (n,), ascending."""
    return np.sort(np.random.default_rng(seed).permutation(samples)[:most])


class _Part(NamedTuple):
    """Of a fold: the samples to learn from, and to judge by."""

    learn: IntArray
    judge: IntArray


@dataclass(frozen=True, eq=False)
class _Fit:
    """The Gauss-Newton method. labels: the kinds of residuals."""

    labels: tuple[str, ...]

    def run(
        self, contacts: Contacts, samples: IntArray, progress: Callable[[int], None]
    ) -> tuple[LearnedEnergy, Sampled, bool]:
        """The energy of samples (n,), these under it, and whether it has converged."""
        learned = LearnedEnergy.of((_START,))
        for left in reversed(range(ITERATIONS)):
            found = contacts.at(samples, learned, progress)
            after = self.iteration(found, learned)
            converged = abs(after.fourth - learned.fourth) < _CONVERGED * learned.fourth
            if converged or not left:
                break
            learned = after
        progress(left * len(samples))
        return learned, found, converged

    def iteration(self, sampled: Sampled, learned: LearnedEnergy) -> LearnedEnergy:
        """The next energy, from one and samples under it."""
        normal = right = 0.0
        for kind in self.labels:
            true, slopes = sampled.truth[kind], sampled.slopes[kind]
            miss = true - sampled.found[kind]
            off = np.linalg.norm(miss, axis=1)
            weight = np.minimum(1.0, _HUBER * np.median(off) / np.maximum(off, 1e-30))
            weight /= np.square(true).sum(axis=1).mean()
            normal += float(weight @ np.square(slopes).sum(axis=1))
            right += float(weight @ (slopes * miss).sum(axis=1))
        right -= _RIDGE * normal * learned.fourth
        change = right / max((1.0 + _RIDGE) * normal, _TINY)
        return LearnedEnergy.of((min(max(learned.fourth + change, LEAST), MOST),))
