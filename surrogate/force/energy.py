"""Learns the energy of contact (`runtime/contact/learned_energy/`) from the energies and forces of a truth.

A sample of the truth has the energy W_true that contact adds, and the generalised contact force h_true = dW_true/dq on
the handles, which are free: h_true is the Lagrange multiplier of the constraint. The parameters p = (c, b) of
condensed contact, whose derivatives follow from one contact solve (`sampled_contacts.py`), are found by a few
Gauss-Newton iterations on

    sum_i sum_k w_ik |r_ik|^2 / <|true_k|^2>

over samples i and three kinds of residual k: h~ - h_true along the coordinates of the handles, its sum, which is the
force on the collider, and W~ - W_true. So strong contacts count most: they move bodies, and where forces are weak,
linear mechanics with few contact points errs in ways that no p changes (docs/results_bodies.md, the small Ball).
Samples in which the collider presses a rigid frame as well are left out: a frame bears by itself
(`runtime/dynamics/terms/frame_contact.py`). w_ik takes weight from what no p fits (Huber 1964), as where the truth is
in another equilibrium. Of p, as much is kept as validation samples bear out: a part t p, with t from 0, which is linear
mechanics, to 1. Of those whose gain over linear mechanics is significant it is the one with the largest gain less its
standard error (`energy_gain.py`), as of a network (`kept_part.py`). How the compliance changes with the strain, c, is
learned only from several states: no other could bear out that of one, and it would count most where a body is strained
much more than in training.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple, Protocol

import numpy as np

from softprint.runtime.arrays import Array, BoolArray, IntArray
from softprint.runtime.colliders.collider import Collider
from softprint.runtime.contact.carriers.compliance_scale import N_COEFFICIENTS
from softprint.runtime.contact.frame_points import FramePoints
from softprint.runtime.contact.learned_energy.learned_energy import LEAST, MOST, LearnedEnergy
from softprint.runtime.dynamics.handle_forces import HandleCoordinates
from softprint.runtime.learned.force.contact_state import ContactStateProbe
from softprint.runtime.scenes.scene import held_frames
from softprint.runtime.truth.shared_samples import workers_for
from softprint.surrogate.data.training_data import TrainingData
from softprint.surrogate.force.energy_gain import gain_of
from softprint.surrogate.force.sampled_contacts import LABELS, N_PARAMETERS, Sampled, SampledContacts
from softprint.surrogate.force.shared_contacts import SharedContacts

ITERATIONS = 3
# Samples to learn from, and to measure the error on: four numbers are learned.
SAMPLES = 600
# Of the median residual, that from which on a sample loses weight.
_HUBER = 2.0
# The ridge on the parameters, relative to the normal matrix, for bodies that are never strained one way.
_RIDGE = 1e-3
# Parts t of what was learned, of which one is kept, or none.
_PARTS = (0.25, 0.5, 0.75, 1.0)


ContactMaker = Callable[[Collider, LearnedEnergy], ContactStateProbe]


class EnergyErrors(NamedTuple):
    """Errors of W and h by kind, sqrt(sum |r_k|^2 / sum s_k) over the samples that are `comparable`. mechanics: of
    linear mechanics; learned; samples: their number; part: t, how much of what was learned is kept."""

    mechanics: dict[str, float]
    learned: dict[str, float]
    samples: int
    part: float


class Contacts(Protocol):
    """Contacts of samples: `SampledContacts`, or shared out among the cores."""

    def at(self, samples: IntArray, learned: LearnedEnergy, progress: Callable[[int], None]) -> Sampled: ...

    def n_states(self, samples: IntArray) -> int: ...


def learn_energy(
    contacts: Contacts,
    train: IntArray,
    held_out: IntArray,
    progress: Callable[[int], None],
    labels: tuple[str, ...] = LABELS,
) -> tuple[LearnedEnergy | None, EnergyErrors]:
    """The energy from samples (n,), and its errors on others; None where it is not significantly better on these
    than linear mechanics, or where all samples press a rigid frame. labels: the kinds of residuals to learn from."""
    mechanics = LearnedEnergy.of_mechanics()
    alone = contacts.at(train, mechanics, progress)
    before = contacts.at(held_out, mechanics, progress)
    compared, train = before.comparable, alone.samples[~alone.on_frames]
    of_mechanics = best = before.errors(compared)
    if not len(train) or not len(compared):
        return None, EnergyErrors(of_mechanics, best, len(compared), 0.0)
    learned, free = mechanics, np.full(N_PARAMETERS, True)
    free[:N_COEFFICIENTS] = contacts.n_states(train) > 1
    for _ in range(ITERATIONS):
        learned = _stepped(learned, _step(contacts.at(train, learned, progress), learned, labels, free))
    kept, part, most = None, 0.0, -np.inf
    for share in _PARTS:
        tried = _with_parameters(share * _parameters(learned))
        found = contacts.at(held_out, tried, progress)
        gain = gain_of(found, before, compared, labels)
        if gain.significant and gain.borne_out > most:
            most, kept, part, best = gain.borne_out, tried, share, found.errors(compared)
    return kept, EnergyErrors(of_mechanics, best, len(compared), part)


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
    """The energy that training data ask for, and its errors on validation samples; None where the truth has no forces.
    contact_of: makes the contact of the body with a collider."""
    rng = np.random.default_rng(data.context.seed)
    train, held_out = (
        np.sort(rng.permutation(with_forces(data, part))[:SAMPLES])
        for part in (data.split.train, data.held_out)
    )
    if not len(train) or not len(held_out):
        return None
    contacts = contacts_of(data, contact_of)
    total = (1 + ITERATIONS) * len(train) + (1 + len(_PARTS)) * len(held_out)
    both = np.union1d(train, held_out)
    data.build_colliders(both)
    with (
        data.context.progress(total, "sample", "learning the energy of contact") as bar,
        SharedContacts(contacts, data.truth, workers_for(data.truth, both)) as shared,
    ):
        learned, errors = learn_energy(shared, train, held_out, bar.update)
    told = (f"{kind} {errors.mechanics[kind]:.1%} -> {errors.learned[kind]:.1%}" for kind in LABELS)
    what = "that of linear mechanics, than which nothing learned is significantly better"
    if learned is not None:
        what = f"learned, {errors.part:.0%} of it kept"
    data.context.say(f"energy of contact: {what}; errors on held-out samples: {', '.join(told)}")
    return learned, errors


def _step(sampled: Sampled, learned: LearnedEnergy, labels: tuple[str, ...], free: BoolArray) -> Array:
    """The change of the parameters (N_PARAMETERS,) of one Gauss-Newton iteration; free: (N_PARAMETERS,) those that
    change."""
    normal, right = np.zeros((N_PARAMETERS, N_PARAMETERS)), np.zeros(N_PARAMETERS)
    for kind in labels:
        true, slopes = sampled.truth[kind], sampled.slopes[kind]
        miss = true - sampled.found[kind]
        off = np.linalg.norm(miss, axis=1)
        weight = np.minimum(1.0, _HUBER * np.median(off) / np.maximum(off, 1e-30))
        weight /= np.square(true).sum(axis=1).mean()
        normal += np.einsum("s,sfk,sfl->kl", weight, slopes, slopes)
        right += np.einsum("s,sfk,sf->k", weight, slopes, miss)
    ridge = _RIDGE * np.diag(np.diag(normal)) + 1e-12 * np.trace(normal) * np.eye(N_PARAMETERS)
    change, right = np.zeros(N_PARAMETERS), right - ridge @ _parameters(learned)
    change[free] = np.linalg.solve((normal + ridge)[np.ix_(free, free)], right[free])
    return change


def _parameters(learned: LearnedEnergy) -> Array:
    """p (N_PARAMETERS,)."""
    return np.array(learned.values)


def _stepped(learned: LearnedEnergy, change: Array) -> LearnedEnergy:
    """With the parameters changed, within their bounds."""
    *coefficients, growth = _parameters(learned) + change
    return _with_parameters([*coefficients, np.clip(growth, LEAST, MOST)])


def _with_parameters(parameters: Sequence[float] | Array) -> LearnedEnergy:
    """With parameters p (N_PARAMETERS,)."""
    return LearnedEnergy.of(tuple(map(float, parameters)))
