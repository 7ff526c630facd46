"""The force model: a network that corrects the contact forces of linear mechanics, for any collider.

    phi_j = l_j + t fade(D) [ y_0 l_j + w_j c R_j^T sum_k y_k v_jk ],        u_X = R_X sum_j (G_Xj phi_j + G~_Xj psi_j),
    psi_j =       t fade(D) [ y'_0 l_j + w_j c R_j^T sum_k y'_k v_jk ],

with l_j the contact force in equilibrium with a linearly elastic body (`runtime/contact/solver/contact_solve.py`),
psi_j spread in the body around the point (`runtime/mechanics/compliance/spread_compliance.py`), w_j [m^(dim-1)] an area
that fades with distance, D the depth of the contact, t a confidence factor (`confidence.py`), c [N/m^(dim-1)] a scale,
v_jk directions of the contact itself, and (y, y')(a_j, D) a network that is evaluated at the few points in contact and
not at all points of the body. Its inputs a_j are invariants of the contact at the point and around it
(`contact_state.py`): where body and collider are rotated together u rotates with them, and nothing depends on the axes
of the collider, on its identity, or on the position on it. With y = y' = 0 the field is that of linear elasticity.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, ClassVar, Literal, Self

import torch
from torch import Tensor, nn
from torch.nn.functional import pad

from softprint.runtime.body.body import ReducedBody
from softprint.runtime.body.rotations import rotation_dofs
from softprint.runtime.contact.learned_energy.learned_energy import LearnedEnergy
from softprint.runtime.contact.penalty import PenaltyContact
from softprint.runtime.learned.fade import Fade
from softprint.runtime.learned.force.confidence import Confidence
from softprint.runtime.learned.force.inputs import DIRECTIONS, least_spread, n_contact_inputs
from softprint.runtime.learned.form import LearnedModel, ModelOptions
from softprint.runtime.learned.network import Mlp, spread
from softprint.runtime.mechanics.body_mechanics import BodyMechanics
from softprint.runtime.mechanics.joint_settling import Joints, JointSettling

SATURATION = 4.0  # R


@dataclass(frozen=True)
class ForceModelOptions(ModelOptions):
    """widths, activation: of the network; fade_depth [m]: depth of the contact below which the correction fades out;
    band [m]: contact points up to this distance outside the collider are included; stiffness: of the penalty contact
    [N/m^4]; static_condensation: whether reduced positions include static condensation; refinement,
    reduced_refinement: of the contact law, see `PenaltyContact`; energy: `values` of the `LearnedEnergy` of contact,
    none without one; settling: states, joints and nodes of the `JointSettling`, none without one."""

    widths: tuple[int, ...]
    activation: Literal["tanh", "silu", "softplus", "elu"]
    fade_depth: float
    band: float
    stiffness: float
    static_condensation: bool = True
    refinement: int = 2
    reduced_refinement: int = 1
    energy: tuple[float, ...] = ()
    settling: tuple[int, ...] = ()

    @property
    def learned(self) -> LearnedEnergy | None:
        """The energy of contact; None for that of linear mechanics."""
        return LearnedEnergy.of(self.energy) if self.energy else None

    @classmethod
    def from_json(cls, values: Mapping[str, Any]) -> Self:
        """See `ModelOptions`. Raises ValueError for an energy that does not grow, too."""
        lists = {name: tuple(values[name]) for name in ("energy", "settling")}
        options = super().from_json({**values, **lists})
        if options.energy:
            LearnedEnergy.of(options.energy)
        return options

    @property
    def law(self) -> PenaltyContact:
        """The contact law that the model was made for."""
        return PenaltyContact(self.stiffness, self.refinement, self.reduced_refinement)


class ForceModel(LearnedModel):
    """phi and psi for bodies in dim dimensions with n_rows handle rows. Buffers hold the normalisation."""

    form: ClassVar[str] = "force"
    options: ForceModelOptions
    local_mean: Tensor
    local_scale: Tensor
    depth_mean: Tensor
    depth_scale: Tensor
    traction_scale: Tensor
    settling_angles: Tensor
    settling_weights: Tensor

    def __init__(self, options: ForceModelOptions, dim: int, n_rows: int) -> None:
        super().__init__()
        self.options, self.dim, self.n_rows = options, dim, n_rows
        n_local = n_contact_inputs(dim)
        self.network = Mlp(n_local, 1, options.widths, 2 * (1 + DIRECTIONS), options.activation)
        # Before training, the field is that of linear elasticity.
        nn.init.zeros_(self.network.head.weight)
        nn.init.zeros_(self.network.head.bias)
        self.fade = Fade("saturating", options.fade_depth)
        self.confidence = Confidence(n_local)
        self.register_buffer("local_mean", torch.zeros(n_local))
        self.register_buffer("local_scale", torch.ones(n_local))
        self.register_buffer("depth_mean", torch.zeros(1))
        self.register_buffer("depth_scale", torch.ones(1))
        self.register_buffer("traction_scale", torch.ones(()))
        if options.settling:
            states, joints, nodes = options.settling
            angles = torch.zeros(states, joints, rotation_dofs(dim), dtype=torch.float64)
            self.register_buffer("settling_angles", angles)
            self.register_buffer("settling_weights", torch.zeros(nodes, dim, states))

    @torch.no_grad()
    def settle(self, settling: JointSettling) -> None:
        """Keep what is learned of joints, of the sizes of the options."""
        self.settling_angles.copy_(torch.from_numpy(settling.angles))
        self.settling_weights.copy_(torch.from_numpy(settling.weights))

    def settled(self, body: ReducedBody, mechanics: BodyMechanics) -> BodyMechanics:
        """The mechanics of a body with what is learned of its joints, if anything. Raises ValueError for another
        body."""
        if not self.options.settling or mechanics.condensation is None:
            return mechanics
        angles, weights = self.settling_angles.cpu().numpy(), self.settling_weights.cpu().numpy()
        joints = Joints.of(body)
        if (len(joints.pairs), body.n_nodes) != self.options.settling[1:]:
            raise ValueError(f"its settling is of another body than {body.name!r}, with other joints or nodes")
        settling = JointSettling(joints, angles, weights)
        return mechanics._replace(condensation=replace(mechanics.condensation, settling=settling))

    @torch.no_grad()
    def normalise(self, local: Tensor, depth: Tensor, force: Tensor, lever: Tensor) -> None:
        """Set the normalisation from inputs (n, n_local) and depths (samples,), and from contact forces (n, dim) with
        their levers (n, DIRECTIONS, dim), so that outputs of order one give corrections as large as the forces."""
        self.local_mean.copy_(local.mean(0))
        least = torch.from_numpy(least_spread(self.dim)).to(local)
        self.local_scale.copy_(torch.maximum(spread(local), least))
        self.depth_mean.copy_(depth.mean())
        self.depth_scale.copy_(spread(depth[:, None]))
        self.traction_scale.copy_(
            force.square().sum(-1).mean().sqrt() / lever.square().sum((-1, -2)).mean().sqrt()
        )

    def forward(self, local: Tensor, depth: Tensor, force: Tensor, lever: Tensor) -> Tensor:
        """phi and psi (..., m, 2 dim) [N] from the columns of `ContactState`: inputs a (..., m, n_local), D (...),
        forces (..., m, dim) and levers (..., m, DIRECTIONS, dim)."""
        correction = self.correction(local, depth, force, lever)
        z = self.normalised(local)
        shared = self.confidence(z, self.normalised_depth(depth), force, correction)
        return pad(force, (0, self.dim)) + shared * correction

    def correction(self, local: Tensor, depth: Tensor, force: Tensor, lever: Tensor) -> Tensor:
        """fade(D) [y_0 l + c sum_k y_k w R^T v_k] of phi and of psi (..., m, 2 dim), without the confidence factor."""
        shared = saturated(self.normalised_depth(depth))[..., None]
        y = self.network(saturated(self.normalised(local)), shared)
        y = y.unflatten(-1, (2, 1 + DIRECTIONS))
        traction = torch.einsum("...ki,...wk->...wi", lever, y[..., 1:])
        forces = force[..., None, :] * y[..., :1] + self.traction_scale * traction
        return self.fade.value(depth)[..., None, None] * forces.flatten(-2)

    @torch.no_grad()
    def keep(self, part: float) -> None:
        """Keep a part of the correction, in [0, 1]: weights and rho0 are multiplied by it, at no cost at run time."""
        self.network.head.weight.mul_(part)
        self.network.head.bias.mul_(part)
        self.confidence.ceiling.mul_(part)

    def normalised(self, local: Tensor) -> Tensor:
        """z of inputs (..., n_local): zero mean and unit standard deviation over the training data."""
        return (local - self.local_mean) / self.local_scale

    def normalised_depth(self, depth: Tensor) -> Tensor:
        """Of depths D (...) [m], as for inputs."""
        return (depth - self.depth_mean[0]) / self.depth_scale[0]


def saturated(z: Tensor) -> Tensor:
    """R tanh(z / R) of normalised inputs: bounds inputs far outside the training data, so that the correction of an
    unfamiliar contact stays as small as those in training."""
    return SATURATION * torch.tanh(z / SATURATION)
