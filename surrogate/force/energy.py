"""Learns the energy of contact (`runtime/contact/condensed/learned_energy.py`) from the energies and forces of a truth.

A sample of the truth has the energy W_true that contact adds, and the generalised contact force h_true = dW_true/dq on
the handles, which are free: h_true is the Lagrange multiplier of the constraint. Condensed contact with parameters
p = (c, log a, b) gives W~ = g(W) and h~ = g' h, and their derivatives follow from one contact solve,

    dW/dc = -sum_j e_j dtheta_j/dc,    e_j = f_j . u_j,
    dh/dc = c_q^T D (I + G_w D)^-1 c_c - dphi_q^T G dphi_c
            - sum_j [ f_j . (dA_j v_j) dtheta_j/dc + e_j d2theta_j/dq dc ],

in the symbols of `linearised_contact.py`, with c_c = u dtheta/dc + A G dphi_c and dphi_c = phi dtheta/dc. So p is found
by a few Gauss-Newton iterations on

    sum_i sum_k w_ik |r_ik|^2 / (s_ik + kappa <s_k>)

over samples i and three kinds of residual k: h~ - h_true along the coordinates of the handles, its sum, which is the
force on the collider, and W~ - W_true; s_ik is the square of what is true. w_ik takes weight from what no p fits (Huber
1964): where the collider presses a rigid frame as well, or where the truth is on another branch. Of p, as much is kept
as validation samples bear out: a part t p, with t from 0, which is linear mechanics, to 1.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from softprint.runtime.arrays import Array, IntArray
from softprint.runtime.colliders.collider import Collider
from softprint.runtime.contact.condensed.learned_energy import LearnedEnergy
from softprint.runtime.contact.condensed.linearised_contact import LinearisedContact
from softprint.runtime.contact.solver.compliance_scale import N_COEFFICIENTS, ComplianceScale
from softprint.runtime.contact.solver.solved_contact import SolvedContact
from softprint.runtime.dynamics.handle_forces import HandleCoordinates
from softprint.runtime.errors import SoftprintError
from softprint.runtime.learned.force.contact_state import ContactStateProbe
from softprint.runtime.scenes.scene import held_frames
from softprint.runtime.truth.truth_file import TruthData
from softprint.surrogate.data.training_data import TrainingData

#: The kinds of residuals: forces on the handles, the force on the collider, and the energy.
LABELS = ("handles", "collider", "energy")
N_PARAMETERS = N_COEFFICIENTS + 2
ITERATIONS = 3
# kappa, as of `task.py`.
_SHALLOW = 0.1
# Samples to learn from, and to measure the error on: five numbers are learned.
_SAMPLES = 600
# Of the median relative residual, that from which on a sample loses weight.
_HUBER = 2.0
# The ridge on the parameters, relative to the normal matrix, for bodies that are never strained one way.
_RIDGE = 1e-3
# x_0, in the x that 95 of 100 samples stay below.
_SIZE = 2.0
# Parts t of what was learned, of which the best on validation samples is kept.
_PARTS = (0.25, 0.5, 0.75, 1.0)
# Bounds of b, and of log a.
_GROWTH, _FIRST = (-0.9, 4.0), (-1.0, 1.0)


class EnergyErrors(NamedTuple):
    """Errors of W and h by kind, sqrt(sum |r_k|^2 / sum s_k) over samples without those in which the force on the
    collider is off by more than half: there it presses a rigid frame. mechanics: of linear mechanics; learned; samples:
    their number; part: t, how much of what was learned is kept."""

    mechanics: dict[str, float]
    learned: dict[str, float]
    samples: int
    part: float


@dataclass(frozen=True, eq=False)
class Sampled:
    """s samples, by kind: what is true, what is found (s, n_k), and its derivatives by the parameters (s,
    n_k, N_PARAMETERS). mechanics: W (s,) [J] before g."""

    samples: IntArray
    truth: Mapping[str, Array]
    found: Mapping[str, Array]
    slopes: Mapping[str, Array]
    mechanics: Array

    def errors(self, samples: IntArray) -> dict[str, float]:
        """See `EnergyErrors`, over some of the samples."""
        which = np.isin(self.samples, samples)
        return {
            kind: float(np.linalg.norm(self.found[kind][which] - true[which]) / np.linalg.norm(true[which]))
            for kind, true in self.truth.items()
        }

    @property
    def free_of_frames(self) -> IntArray:
        """The samples that do not press a rigid frame."""
        true = self.truth["collider"]
        miss = np.linalg.norm(self.found["collider"] - true, axis=1)
        return self.samples[miss <= 0.5 * np.linalg.norm(true, axis=1)]


class SampledContacts:
    """The contacts of samples of a truth, followed along their approach once and then from the last ones found.
    by_collider: the colliders of some samples, each with its own; contact_of: makes the contact of the body with a
    collider; handles: along which coordinates forces are compared; origins: (n_rows,) 1 for rows that are positions."""

    def __init__(
        self,
        truth: TruthData,
        by_collider: Callable[[IntArray], Iterator[tuple[Collider, IntArray]]],
        contact_of: Callable[[Collider, LearnedEnergy], ContactStateProbe],
        handles: HandleCoordinates,
        origins: Array,
    ) -> None:
        self._truth, self._by_collider, self._contact_of = truth, by_collider, contact_of
        self._handles, self._origins = handles, origins
        self._last: dict[int, SolvedContact] = {}

    def at(self, samples: IntArray, learned: LearnedEnergy, progress: Callable[[int], None]) -> Sampled:
        """Those of the samples in which the reduced body touches the collider."""
        truth, columns = self._truth, list[dict[str, tuple[Array, Array, Array]]]()
        taken, energies = list[int](), list[float]()
        for collider, part in self._by_collider(samples):
            probe = self._contact_of(collider, learned)
            for sample in map(int, part):
                progress(1)
                rows = truth.states["rows"][truth.sample_state[sample]]
                solved = self._solved(probe, sample, rows)
                if solved is None or not len(solved.active):
                    continue
                found = probe.evaluation(solved)
                by_energy, by_force = by_parameters(found.contact, learned)
                h, true = found.gradient, truth.contact_handle_force(sample)
                columns.append(
                    {
                        "handles": self._compared(rows, true, h, by_force),
                        "collider": self._summed(true, h, by_force),
                        "energy": (
                            np.array([truth.contact_energy(sample)]),
                            np.array([found.energy]),
                            by_energy[None],
                        ),
                    }
                )
                taken.append(sample)
                energies.append(solved.solution.energy)
        if not columns:
            raise SoftprintError(
                f"{truth.path}: in none of {len(samples)} samples does the reduced body touch the collider"
            )
        of_truth, of_contact, slopes = (
            {kind: np.stack([one[kind][k] for one in columns]) for kind in LABELS} for k in range(3)
        )
        return Sampled(np.array(taken), of_truth, of_contact, slopes, np.array(energies))

    def _compared(self, rows: Array, true: Array, found: Array, slopes: Array) -> tuple[Array, Array, Array]:
        """Along the coordinates of the handles."""
        along = [np.ascontiguousarray(slope) for slope in np.moveaxis(slopes, -1, 0)]
        by = np.stack([self._handles.along(rows, slope) for slope in along], axis=1)
        return self._handles.along(rows, true), self._handles.along(rows, found), by

    def _summed(self, true: Array, found: Array, slopes: Array) -> tuple[Array, Array, Array]:
        """The force on the body."""
        return self._origins @ true, self._origins @ found, np.einsum("r,rak->ak", self._origins, slopes)

    def _solved(self, probe: ContactStateProbe, sample: int, rows: Array) -> SolvedContact | None:
        poses, solved = self._truth.approach_path(sample), self._last.get(sample)
        for pose in poses if solved is None else poses[-1:]:
            solved = probe.solve(rows, pose, solved)
        if solved is not None:
            self._last[sample] = solved
        return solved


def learn_energy(
    contacts: SampledContacts,
    train: IntArray,
    held_out: IntArray,
    progress: Callable[[int], None],
    labels: tuple[str, ...] = LABELS,
) -> tuple[LearnedEnergy | None, EnergyErrors]:
    """The energy from samples (n,), and its errors on others; None where linear mechanics is better on these. labels:
    the kinds of residuals to learn from."""
    mechanics = LearnedEnergy(ComplianceScale((0.0,) * N_COEFFICIENTS), 1.0, 0.0, 1.0)
    dents = np.cbrt(contacts.at(train, mechanics, progress).mechanics)
    learned = replace(mechanics, size=_SIZE * float(np.quantile(dents, 0.95)))
    for _ in range(ITERATIONS):
        learned = _stepped(learned, _step(contacts.at(train, learned, progress), learned, labels))
    before = contacts.at(held_out, mechanics, progress)
    compared = before.free_of_frames
    of_mechanics = best = before.errors(compared)
    kept, part = None, 0.0
    for share in _PARTS:
        tried = _with_parameters(learned, share * _parameters(learned))
        found = contacts.at(held_out, tried, progress).errors(compared)
        if sum(found.values()) < sum(best.values()):
            best, kept, part = found, tried, share
    return kept, EnergyErrors(of_mechanics, best, len(compared), part)


def energy_of(
    data: TrainingData, contact_of: Callable[[Collider, LearnedEnergy], ContactStateProbe]
) -> tuple[LearnedEnergy | None, EnergyErrors] | None:
    """The energy that training data ask for, and its errors on validation samples; None where the truth has no forces.
    contact_of: makes the contact of the body with a collider."""
    truth, body = data.truth, data.body
    known = np.isfinite(truth.samples["handle_force"]).all(axis=(1, 2))
    rng = np.random.default_rng(data.context.seed)
    train, held_out = (
        np.sort(rng.permutation(part[known[part]])[:_SAMPLES]) for part in (data.split.train, data.held_out)
    )
    if not len(train) or not len(held_out):
        return None
    handles = HandleCoordinates(body, held_frames(data.context.experiment))
    contacts = SampledContacts(truth, data.by_collider, contact_of, handles, body.handles.affine_part)
    total = (1 + ITERATIONS) * len(train) + (1 + len(_PARTS)) * len(held_out)
    with data.context.progress(total, "sample", "learning the energy of contact") as bar:
        learned, errors = learn_energy(contacts, train, held_out, bar.update)
    told = (f"{kind} {errors.mechanics[kind]:.1%} -> {errors.learned[kind]:.1%}" for kind in LABELS)
    what = "that of linear mechanics" if learned is None else f"learned, {errors.part:.0%} of it kept"
    data.context.say(f"energy of contact: {what}; errors on held-out samples: {', '.join(told)}")
    return learned, errors


def by_parameters(contact: LinearisedContact | None, learned: LearnedEnergy) -> tuple[Array, Array]:
    """d g/dp (N_PARAMETERS,) [J] and d(g' h)/dp (n_rows, dim, N_PARAMETERS) [N] of a contact with active points."""
    assert contact is not None
    W, h, size = contact.solved.solution.energy, contact.gradient, learned.size
    energy, force = _by_coefficients(contact, learned.scale)
    x, slope = np.cbrt(W), learned.slope(W)
    hardened = LearnedEnergy(learned.scale, learned.first, 1.0, size).energy(W) - learned.first * W
    by_energy = np.concatenate([slope * energy, [learned.energy(W), hardened]])
    by_scale = slope * force.reshape(*h.shape, -1) + learned.curvature(W) * h[..., None] * energy
    by_first, by_growth = slope * h, learned.first * x / (x + size) * h
    return by_energy, np.concatenate([by_scale, by_first[..., None], by_growth[..., None]], axis=2)


def _by_coefficients(contact: LinearisedContact, scale: ComplianceScale) -> tuple[Array, Array]:
    """dW/dc (N_COEFFICIENTS,) and dh/dc (R, N_COEFFICIENTS)."""
    solved, points, factor = contact.solved, contact.points, contact.factor
    b, index = solved.solution.active, solved.active
    u, phi, f = solved.solution.displacement[b], solved.rest_force, solved.solution.force[b]
    by_theta, by_slope = scale.by_coefficients(
        points.deformation(solved.rows, index), points.surface_normals(index)
    )
    k, dim = u.shape
    phi_c = (phi[..., None] * by_theta[:, None]).reshape(k * dim, -1)
    c_c = (u[..., None] * by_theta[:, None]).reshape(k * dim, -1)
    c_c = c_c + factor.to_world(factor.rest_displacement(phi_c))
    stretch = contact.position_jacobian.reshape(k, dim, -1) - contact.motion.position
    along = np.einsum("ka,kar->kr", f, stretch)  # f . dA v
    gradient = contact.motion.basis_gradient
    mixed = np.einsum("kcab,krb->kcra", by_slope, gradient).reshape(k, N_COEFFICIENTS, -1)  # d2theta/dq dc
    work = (f * u).sum(axis=1)
    force = contact.force_response.T @ c_c - contact.displacement_jacobian.T @ phi_c
    force = force - along.T @ by_theta - np.einsum("k,kcr->rc", work, mixed)
    return -work @ by_theta, np.asarray(force)


def _step(sampled: Sampled, learned: LearnedEnergy, labels: tuple[str, ...]) -> Array:
    """The change of the parameters (N_PARAMETERS,) of one Gauss-Newton iteration."""
    normal, right = np.zeros((N_PARAMETERS, N_PARAMETERS)), np.zeros(N_PARAMETERS)
    for kind in labels:
        true, slopes = sampled.truth[kind], sampled.slopes[kind]
        miss, size = true - sampled.found[kind], np.square(true).sum(axis=1)
        weight = 1.0 / (size + _SHALLOW * size.mean())
        relative = np.sqrt(weight * np.square(miss).sum(axis=1))
        weight = weight * np.minimum(1.0, _HUBER * np.median(relative) / np.maximum(relative, 1e-30))
        normal += np.einsum("s,sfk,sfl->kl", weight, slopes, slopes)
        right += np.einsum("s,sfk,sf->k", weight, slopes, miss)
    ridge = _RIDGE * np.diag(np.diag(normal)) + 1e-12 * np.trace(normal) * np.eye(N_PARAMETERS)
    return np.asarray(np.linalg.solve(normal + ridge, right - ridge @ _parameters(learned)))


def _parameters(learned: LearnedEnergy) -> Array:
    """p (N_PARAMETERS,)."""
    return np.array([*learned.scale.coefficients, np.log(learned.first), learned.growth])


def _stepped(learned: LearnedEnergy, change: Array) -> LearnedEnergy:
    """With the parameters changed, within their bounds."""
    *coefficients, first, growth = _parameters(learned) + change
    return _with_parameters(learned, [*coefficients, np.clip(first, *_FIRST), np.clip(growth, *_GROWTH)])


def _with_parameters(learned: LearnedEnergy, parameters: Sequence[float] | Array) -> LearnedEnergy:
    """With other parameters p (N_PARAMETERS,)."""
    *coefficients, first, growth = map(float, parameters)
    return LearnedEnergy(ComplianceScale(tuple(coefficients)), float(np.exp(first)), growth, learned.size)
