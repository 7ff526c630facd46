"""Training data of contact models: the samples of a truth file in collider space (thesis 5.3.1 and 5.3.2).

A sample has thousands of nodes, and neighbouring nodes are strongly correlated. One per cent of the nodes holds half
of the squared displacement, and so does the deepest fifth of the samples. The network is therefore trained on *pools*:
a few nodes and surface edges of one sample, drawn once by importance sampling. Nodes are drawn by the size of the
displacement, edges by the size of its difference, and samples with a larger displacement get more pools. Weights make
the mean over pools an unbiased estimate of the mean over samples and volume.

`splits.py` decides which samples are for training and which are held out.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from typing import Any, NamedTuple, cast

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from softprint.runtime.arrays import Array, IntArray
from softprint.runtime.body.body import ReducedBody
from softprint.runtime.colliders.collider import Collider
from softprint.runtime.errors import SoftprintError
from softprint.runtime.learned.contact_patch import ContactProbe
from softprint.runtime.learned.point_states import PointStates, PointTensors
from softprint.runtime.truth.truth_file import TruthData
from softprint.surrogate.data.touching import touching_samples

# Shares of points (nodes, edges) and of pools drawn uniformly; the rest is drawn by the size of the displacement.
_EVEN_POINTS, _EVEN_POOLS = 0.3, 0.2
# Number of samples used to estimate the mean displacement; each sample's number of pools is relative to this mean.
_SCALE_SAMPLES = 200


@dataclass(frozen=True)
class PoolSize:
    """pools: per sample, on average; nodes, edges: per pool."""

    pools: int
    nodes: int
    edges: int


class Batch(NamedTuple):
    """b pools. state: (b, k, ...); shared (b, n_shared); depth (b,); target (b, k, dim) [m] in
    collider space; node_weight (b, nodes), edge_weight (b, edges). The k points are nodes, then first ends, then
    second ends of edges."""

    state: PointStates
    shared: Tensor
    depth: Tensor
    target: Tensor
    node_weight: Tensor
    edge_weight: Tensor


@dataclass(frozen=True, eq=False)
class Pools:
    """contact: (p,) the sample of each pool, as a row of the data set. Per pool p and point k: nodes (p, k),
    signed distance sdf (p, k), its gradient slope (p, k, dim) and the target (p, k, dim)."""

    contact: Tensor
    nodes: Tensor
    sdf: Tensor
    slope: Tensor
    target: Tensor
    node_weight: Tensor
    edge_weight: Tensor

    def balanced(self) -> Pools:
        """The same pools, with weights that compensate for different numbers of pools per sample."""
        per_sample = torch.bincount(self.contact).clamp(min=1)
        weight = (len(self.contact) / (len(per_sample) * per_sample))[self.contact, None]
        return replace(
            self,
            node_weight=self.node_weight * weight,
            edge_weight=self.edge_weight * weight,
        )

    def to(self, device: torch.device) -> Pools:
        """The same pools on a device."""
        return Pools(*(cast(Tensor, getattr(self, field.name)).to(device) for field in fields(self)))


@dataclass(frozen=True, eq=False)
class ContactDataset:
    """Samples of one collider, and the pools drawn from them. rows: (s, n_rows, dim) collider rows; shared: (s,
    n_shared); depth: (s,) [m]; sample: (s,) row of the truth file; state: (s,) its state."""

    points: PointTensors
    rows: Tensor
    shared: Tensor
    depth: Tensor
    sample: IntArray
    state: IntArray
    pools: Pools

    def __len__(self) -> int:
        """Number of pools."""
        return len(self.pools.contact)

    def batch(self, index: Tensor) -> Batch:
        """Pools `index` (b,)."""
        pools, contact = self.pools, self.pools.contact[index]
        points, rows = self.points.take(pools.nodes[index]), self.rows[contact]
        z = points.basis @ rows
        F = torch.einsum("brj,bnrk->bnjk", rows, points.basis_gradient)
        state = PointStates(points, rows, z, F, pools.sdf[index], pools.slope[index])
        return Batch(
            state,
            self.shared[contact],
            self.depth[contact],
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


def load_dataset(
    truth: TruthData,
    body: ReducedBody,
    collider: Collider,
    samples: IntArray,
    size: PoolSize | None,
    rng: np.random.Generator,
    progress: Callable[[int], None] | None = None,
) -> ContactDataset:
    """The given rows of a truth file. With size None, each sample has one pool of all nodes and no edges, for
    measuring errors.

    Samples in which the *reduced* body does not touch the collider give a model no contact to evaluate; they are
    dropped.
    """
    probe = ContactProbe(body, collider)
    drawing = (
        _Whole(body) if size is None else _Drawing(body, size, _mean_size(truth, body, samples, rng), rng)
    )
    columns: list[tuple[Array, Tensor, float, int]] = []
    pools: list[tuple[NDArray[Any], ...]] = []
    for sample, rows, pose, patch in touching_samples(truth, samples, probe, progress):
        local_rows = probe.collider_rows(rows, pose)
        target = pose.rotate_inverse(truth.displacement(sample).astype(np.float64))
        points, node_weight, edge_weight = drawing.draw(target)
        z = (body.basis @ local_rows)[points]
        distance = collider.sdf_derivatives(z.reshape(-1, body.dim))
        numbers = (
            distance.value.reshape(points.shape),
            distance.gradient.reshape(z.shape),
            target[points],
            node_weight,
            edge_weight,
        )
        contact = np.full(len(points), len(columns))
        pools.append((contact, points, *(part.astype(np.float32) for part in numbers)))
        columns.append((local_rows, patch.shared, patch.depth, int(sample)))
    if not columns:
        raise SoftprintError(
            f"{truth.path}: in none of the {len(samples)} requested samples does the reduced body touch the collider"
        )
    rows_, shared, depth, kept = zip(*columns, strict=True)
    kept_samples = np.array(kept)
    drawn = Pools(*(torch.from_numpy(np.concatenate(column)) for column in zip(*pools, strict=True)))
    if size is not None:
        drawn = drawn.balanced()
    return ContactDataset(
        PointTensors.of(body.node_points(), torch.zeros(())),
        torch.from_numpy(np.array(rows_, dtype=np.float32)),
        torch.stack(shared).float(),
        torch.tensor(depth),
        kept_samples,
        truth.sample_state[kept_samples],
        drawn,
    )


def _rms(values: NDArray[np.floating[Any]], weight: Array) -> float:
    return float(np.sqrt(weight @ np.square(values).sum(axis=1) / weight.sum()))


def _mean_size(truth: TruthData, body: ReducedBody, samples: IntArray, rng: np.random.Generator) -> float:
    """Estimated mean over samples of the root-mean-square displacement [m]."""
    some = np.sort(rng.permutation(samples)[:_SCALE_SAMPLES])
    return float(np.mean([_rms(truth.displacement(int(sample)), body.mesh.node_volumes) for sample in some]))


class _Whole:
    """All nodes of a sample and no edges."""

    def __init__(self, body: ReducedBody) -> None:
        self._nodes = np.arange(body.n_nodes)
        self._weight = body.mesh.node_volumes / body.mesh.node_volumes.mean()

    def draw(self, _target: Array) -> tuple[IntArray, Array, Array]:
        """Same as :meth:`_Drawing.draw`."""
        return self._nodes[None], self._weight[None], np.empty((1, 0))


class _Drawing:
    """Draws the pools of samples; mean_size: mean RMS displacement of a sample [m]."""

    def __init__(self, body: ReducedBody, size: PoolSize, mean_size: float, rng: np.random.Generator) -> None:
        self._size, self._mean_size, self._rng = size, mean_size, rng
        self._volume = body.mesh.node_volumes / body.mesh.node_volumes.mean()
        self._edges = body.mesh.surface_edges

    def draw(self, target: Array) -> tuple[IntArray, Array, Array]:
        """c pools of a sample with displacement target (n_nodes, dim): points (c, k), which are nodes, first ends and
        second ends of edges, and the weights of nodes and edges."""
        size, edges = self._size, self._edges
        relative = _rms(target, self._volume) / self._mean_size
        wanted = size.pools * (_EVEN_POOLS + (1.0 - _EVEN_POOLS) * relative)
        # Stochastic rounding, so that the mean number of pools is `wanted`.
        count = max(1, int(wanted + self._rng.random()))
        at_nodes = np.linalg.norm(target, axis=1)
        along_edges = np.linalg.norm(target[edges[:, 0]] - target[edges[:, 1]], axis=1)
        nodes, node_weight = self._weighted_draw(at_nodes, (count, size.nodes))
        ends, edge_weight = self._weighted_draw(along_edges, (count, size.edges))
        node_weight *= self._volume[nodes]
        points = np.concatenate([nodes, edges[ends, 0], edges[ends, 1]], axis=1)
        return points, node_weight, edge_weight

    def _weighted_draw(self, weight: Array, shape: tuple[int, int]) -> tuple[IntArray, Array]:
        """Indices drawn with p = even / n + (1 - even) weight / sum, and their weights 1 / (n p)."""
        n = len(weight)
        p = np.full(n, 1.0 / n)
        if (total := weight.sum()) > 0.0:
            p = _EVEN_POINTS / n + (1.0 - _EVEN_POINTS) * weight / total
        drawn = self._rng.choice(n, size=shape, p=p / p.sum())
        return drawn, 1.0 / (n * p[drawn])
