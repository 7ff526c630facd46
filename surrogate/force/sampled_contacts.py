"""Solved contacts at samples of a truth, with the derivatives of forces and energy by the parameters of the energy.

Condensed contact with parameters p = (c, b) gives W~ = W exp[b eta(chi)] with eta = log(1 + chi)
(`runtime/contact/learned_energy/`), and

    h~ = W~/W h + W~ b eta' dchi/dq.

Their derivatives follow from one contact solve,

    dW/dc = -sum_j e_j dtheta_j/dc,    e_j = f_j . u_j,
    dh/dc = c_q^T D (I + G_w D)^-1 c_c - dphi_q^T G dphi_c
            - sum_j [ f_j . (dA_j v_j) dtheta_j/dc + e_j d2theta_j/dq dc ],

in the symbols of `runtime/contact/linearised/linearised_contact.py`, with c_c = u dtheta/dc + A G dphi_c and dphi_c =
phi dtheta/dc. chi changes by dchi/dc = -sum_j [ lambda_j . u_j + mu_j . phi_j ] dtheta_j/dc (`hardened_contact.py`);
that dchi/dq changes with c, too, is left out.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from softprint.runtime.arrays import Array, BoolArray, IntArray
from softprint.runtime.colliders.collider import Collider
from softprint.runtime.contact.carriers.compliance_scale import N_COEFFICIENTS, ComplianceScale
from softprint.runtime.contact.frame_points import FramePoints
from softprint.runtime.contact.learned_energy.dent_excess import DentExcess
from softprint.runtime.contact.learned_energy.hardened_contact import excess_response, measure_slopes
from softprint.runtime.contact.learned_energy.learned_energy import LearnedEnergy, hardening
from softprint.runtime.contact.linearised.linearised_contact import LinearisedContact
from softprint.runtime.contact.solver.solved_contact import SolvedContact
from softprint.runtime.dynamics.handle_forces import HandleCoordinates
from softprint.runtime.errors import SoftprintError
from softprint.runtime.learned.force.contact_state import ContactStateProbe
from softprint.runtime.truth.truth_file import TruthData

#: The kinds of residuals: forces on the handles, the force on the collider, and the energy.
LABELS = ("handles", "collider", "energy")
N_PARAMETERS = N_COEFFICIENTS + 1


class TouchingSample(NamedTuple):
    """A row of the truth file, what is true and found there and its derivatives, see `Sampled`, and whether the
    collider presses a rigid frame."""

    sample: int
    columns: Mapping[str, tuple[Array, Array, Array]]
    on_frame: bool


@dataclass(frozen=True, eq=False)
class Sampled:
    """s samples, by kind: what is true, what is found (s, n_k), and its derivatives by the parameters (s, n_k,
    N_PARAMETERS); contacts: (s,) each sample's contact in the truth; its depths share one; on_frames: (s,) whether the
    collider presses a rigid frame, whose force no energy of a dent has."""

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
                contact, own = found.contact, found.excess
                assert contact is not None  # some points are active
                assert own is not None
                by_energy, by_force = by_parameters(contact, learned, own)
                h, true = found.gradient, truth.contact_handle_force(sample)
                columns = {
                    "handles": self._compared(rows, true, h, by_force),
                    "collider": self._summed(true, h, by_force),
                    "energy": (
                        np.array([truth.contact_energy(sample)]),
                        np.array([found.energy]),
                        by_energy[None],
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
        along = [
            self._handles.along(rows, np.ascontiguousarray(slope)) for slope in np.moveaxis(slopes, -1, 0)
        ]
        return self._handles.along(rows, true), self._handles.along(rows, found), np.stack(along, axis=1)

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


def by_parameters(
    contact: LinearisedContact, learned: LearnedEnergy, excess: DentExcess
) -> tuple[Array, Array]:
    """dW~/dp (N_PARAMETERS,) [J] and dh~/dp (n_rows, dim, N_PARAMETERS) [N] of a contact with active points and its
    excess."""
    W, h, eta = contact.solved.solution.energy, contact.gradient, hardening(excess.value)
    response = excess_response(contact, excess)
    terms, r = learned.terms(W, excess.value), measure_slopes(contact, response)[:, 1].reshape(h.shape)
    energy, force, of_excess = _by_coefficients(contact, learned.scale, response)
    _, rate = terms.slope / terms.value
    found = terms.value * (h / W + rate * r)
    by_excess = terms.curvature[0, 1] / W * h + terms.curvature[1, 1] * r
    by_energy = terms.value * np.concatenate([energy / W + rate * of_excess, [eta.value]])
    by_scale = terms.value / W * (force.reshape(*h.shape, -1) + rate * r[..., None] * energy)
    by_scale = by_scale + by_excess[..., None] * of_excess
    by_growth = eta.value * found + terms.value * eta.slope * r
    return by_energy, np.concatenate([by_scale, by_growth[..., None]], axis=2)


def _by_coefficients(
    contact: LinearisedContact, scale: ComplianceScale, response: tuple[Array, Array]
) -> tuple[Array, Array, Array]:
    """dW/dc (N_COEFFICIENTS,), dh/dc (R, N_COEFFICIENTS) and dchi/dc (N_COEFFICIENTS,). response: lambda and mu."""
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
    stretch, _ = contact.carrier_motion(f, solved.solution.rest_displacement[b])
    along = np.einsum("ka,kar->kr", f, stretch.reshape(k, dim, -1))  # f . dA v
    gradient = contact.derivatives.basis_gradient
    mixed = np.einsum("kcab,krb->kcra", by_slope, gradient).reshape(k, N_COEFFICIENTS, -1)  # d2theta/dq dc
    work = (f * u).sum(axis=1)
    force = contact.motions.reaction.T @ c_c - contact.motions.displacement.T @ phi_c
    force = force - along.T @ by_theta - np.einsum("k,kcr->rc", work, mixed)
    forces, moved = (part.reshape(k, dim) for part in response)
    of_excess = (forces * u).sum(axis=1) + (moved * phi).sum(axis=1)
    return -work @ by_theta, np.asarray(force), -of_excess @ by_theta
