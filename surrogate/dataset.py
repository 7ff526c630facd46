"""Training data of contact models: the samples of a truth file in collider space (thesis 5.3.1 and 5.3.2).

A sample has thousands of nodes, and neighbours tell the same story. Each sample keeps a *pool* drawn once:
nodes, half of them evenly over the body and half near the contact patch, and surface edges near the patch for
the edge term of the loss. Every draw carries the weight that makes the sum over the pool an unbiased estimate
of the integral.

Splits are by *state*: the held-out error must measure states never seen. Samples that are not converged or
that follow a branch jump are left out and counted.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields
from typing import Any, NamedTuple, cast

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from runtime.arrays import Array, IntArray
from runtime.body.body import ReducedBody
from runtime.colliders.collider import Collider
from runtime.corrections.contact_patch import ContactProbe
from runtime.corrections.points import PointStates, PointTensors
from runtime.errors import SoftprintError
from runtime.truth_file import TruthData

# Nodes near the patch are drawn with probability falling by 1/e over this share of the collider's size.
_NEAR = 0.4


@dataclass(frozen=True)
class PoolSize:
    """How many nodes and surface edges of each sample are kept."""

    nodes: int
    edges: int

    @property
    def points(self) -> int:
        return self.nodes + 2 * self.edges


class Batch(NamedTuple):
    """Pools of some samples. state: (b, k, ...); shared (b, n_shared); depth (b,); target (b, k, dim) [m] in
    collider space; node_weight (b, nodes), edge_weight (b, edges). Points are nodes, then first ends, then
    second ends of edges."""

    state: PointStates
    shared: Tensor
    depth: Tensor
    target: Tensor
    node_weight: Tensor
    edge_weight: Tensor


@dataclass(frozen=True, eq=False)
class Pools:
    """Per sample s and pool point k: nodes (s, k), signed distance (s, k), its gradient and the target (s, k,
    dim)."""

    nodes: Tensor
    sdf: Tensor
    slope: Tensor
    target: Tensor
    node_weight: Tensor
    edge_weight: Tensor

    def to(self, device: torch.device) -> Pools:
        """The same pools on a device."""
        return Pools(*(cast(Tensor, getattr(self, field.name)).to(device) for field in fields(self)))


@dataclass(frozen=True, eq=False)
class ContactDataset:
    """Samples of one collider. rows: (s, n_rows, dim) collider rows; shared: (s, n_shared); depth: (s,) [m];
    sample: (s,) row of the truth file; state: (s,) its state."""

    points: PointTensors
    rows: Tensor
    shared: Tensor
    depth: Tensor
    sample: IntArray
    state: IntArray
    pools: Pools

    def __len__(self) -> int:
        return len(self.rows)

    def batch(self, index: Tensor) -> Batch:
        """The pools of samples `index` (b,)."""
        pools, points, rows = self.pools, self.points.take(self.pools.nodes[index]), self.rows[index]
        z = points.basis @ rows
        F = torch.einsum("brj,bnrk->bnjk", rows, points.basis_gradient)
        state = PointStates(points, rows, z, F, pools.sdf[index], pools.slope[index])
        return Batch(
            state,
            self.shared[index],
            self.depth[index],
            pools.target[index],
            pools.node_weight[index],
            pools.edge_weight[index],
        )

    def to(self, device: torch.device) -> ContactDataset:
        """The same data on a device."""
        return ContactDataset(
            self.points.to(device),
            self.rows.to(device),
            self.shared.to(device),
            self.depth.to(device),
            self.sample,
            self.state,
            self.pools.to(device),
        )


@dataclass(frozen=True)
class Split:
    """Rows of the truth file for training and for validation, and how many samples were left out as
    unusable."""

    train: IntArray
    validation: IntArray
    left_out: int


def split_by_state(truth: TruthData, collider: str, validation_states: int) -> Split:
    """Hold out the last `validation_states` states (they are in farthest-point order). Samples of `collider`
    only."""
    if collider not in truth.header.colliders:
        known = ", ".join(truth.header.colliders)
        raise SoftprintError(f"{truth.path}: has no samples of collider {collider!r}; its colliders: {known}")
    ours = truth.contacts["collider"][truth.samples["contact"]] == truth.header.colliders.index(collider)
    usable = truth.usable & ours
    states = np.unique(truth.sample_state[usable])
    if len(states) <= validation_states:
        raise SoftprintError(
            f"{truth.path}: has usable samples of {len(states)} states; holding out {validation_states} for "
            f"validation (training.validation_states) leaves none to learn from"
        )
    held_out = np.isin(truth.sample_state, states[len(states) - validation_states :])
    return Split(
        np.flatnonzero(usable & ~held_out), np.flatnonzero(usable & held_out), int(ours.sum() - usable.sum())
    )


def load_dataset(
    truth: TruthData,
    body: ReducedBody,
    collider: Collider,
    samples: IntArray,
    size: PoolSize | None,
    rng: np.random.Generator,
    progress: Callable[[int], None] | None = None,
) -> ContactDataset:
    """The given rows of a truth file. size None keeps all nodes and no edges, for measuring errors.

    Samples in which the *reduced* body does not touch the collider hold no contact for a model to see; they
    are dropped.
    """
    probe = ContactProbe(body, collider)
    drawing = _Drawing(body, collider, size, rng)
    columns: list[tuple[Array, Tensor, float, int, tuple[NDArray[Any], ...]]] = []
    for sample in samples:
        if progress is not None:
            progress(1)
        rows, pose = truth.states["rows"][truth.sample_state[sample]], truth.pose(int(sample))
        patch = probe.measure(rows, pose)
        if patch is None:
            continue
        local_rows = probe.collider_rows(rows, pose)
        target = pose.rotate_inverse(truth.displacement(int(sample)).astype(np.float64))
        columns.append(
            (
                local_rows,
                patch.shared,
                patch.depth,
                int(sample),
                drawing.draw(local_rows, patch.shared, target),
            )
        )
    if not columns:
        raise SoftprintError(
            f"{truth.path}: none of the {len(samples)} samples asked for touches the reduced body"
        )
    rows_, shared, depth, kept, pools = zip(*columns, strict=True)
    kept_samples = np.array(kept)
    return ContactDataset(
        PointTensors.of(body.node_points(), torch.zeros(())),
        torch.from_numpy(np.array(rows_, dtype=np.float32)),
        torch.stack(shared).float(),
        torch.tensor(depth),
        kept_samples,
        truth.sample_state[kept_samples],
        Pools(*(torch.from_numpy(np.array(column)) for column in zip(*pools, strict=True))),
    )


class _Drawing:
    """Draws the pool of one sample after the other."""

    def __init__(
        self, body: ReducedBody, collider: Collider, size: PoolSize | None, rng: np.random.Generator
    ) -> None:
        mesh = body.mesh
        self._basis, self._collider, self._size, self._rng = body.basis, collider, size, rng
        self._dim = body.dim
        self._volume = mesh.node_volumes / mesh.node_volumes.mean()
        self._edges = mesh.surface_edges

    def draw(self, rows: Array, shared: Tensor, target: Array) -> tuple[NDArray[Any], ...]:
        """Columns of :class:`Pools` for collider rows (n_rows, dim), shared inputs and target (n_nodes,
        dim)."""
        z = self._basis @ rows
        if self._size is None:
            nodes = np.arange(len(z))
            weights = self._volume, np.empty(0)
        else:
            centre = shared[2 : 2 + self._dim].numpy()
            nearness = np.exp(-np.linalg.norm(z - centre, axis=1) / (_NEAR * self._collider.size))
            volume_nodes, node_weight = self._weighted_draw(nearness, 0.5, self._size.nodes)
            edges, edge_weight = self._weighted_draw(
                nearness[self._edges].mean(axis=1), 0.0, self._size.edges
            )
            nodes = np.concatenate([volume_nodes, *self._edges[edges].T])
            weights = self._volume[volume_nodes] * node_weight, edge_weight
        distance = self._collider.sdf_derivatives(z[nodes])
        columns = (distance.value, distance.gradient, target[nodes], *weights)
        return nodes, *(column.astype(np.float32) for column in columns)

    def _weighted_draw(self, weight: Array, even: float, count: int) -> tuple[IntArray, Array]:
        """`count` numbers drawn with p = even / n + (1 - even) weight / sum, and the weights 1 / (n p)."""
        n = len(weight)
        p = even / n + (1.0 - even) * (0.9 * weight / weight.sum() + 0.1 / n)
        drawn = self._rng.choice(n, size=count, p=p / p.sum())
        return drawn, 1.0 / (n * p[drawn])
