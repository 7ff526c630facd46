"""The loss of learned contact forces: an error over the whole volume, evaluated at the loads of the contact alone.

The displacement is linear in the contact forces phi. Pulled back to rest coordinates, with w = F^-1 u of the truth,

    |G^T phi - w|_M^2 = phi^T Gamma phi - 2 phi^T h + c,    Gamma = G M G^T,    h = G M w,    c = w^T M w,

with phi the forces on contact nodes, followed by those that are spread around anchors, and G the columns of both:
forces on contact points act on the nodes of their facets, and from there on the anchors between which spread forces are
interpolated (`loads.py`). M holds both terms of thesis 5.3.1: node volumes, and the graph Laplacian of the surface
edges,

    w^T M w = sum_i V_i |w_i|^2 / sum V + edge_weight * sum_edges |w_a - w_b|^2 / n_edges.

Gamma depends on the body only; for each sample, only c and h at its contact points are stored. The loss is the mean
over samples of

    |G^T phi - w|_M^2 / (c + kappa <c>),

with <c> the mean of c. It interpolates between the error relative to each sample's own displacement (kappa = 0) and
relative to the mean displacement of all samples (kappa to infinity). Without the first term, contacts with small
displacements (under thin walls) would have no weight, and for more of them the correction would be worse than
mechanics alone; without the second, samples that hardly touch would weigh as much as all others.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
import scipy.sparse as sp
import torch
from torch import Tensor

from softprint.runtime.arrays import Array, IntArray
from softprint.runtime.body.body import ReducedBody
from softprint.runtime.mechanics.body_mechanics import BodyMechanics

# Rows of Gamma computed together. Only the upper half is computed (diagonal blocks in full), the rest is mirrored.
_PANEL = 1024


class ForceMetric:
    """Gamma of a body, with and without the edge term: (n, n, dim, dim) float32, of n = n_contact + n_anchors loads."""

    def __init__(self, body: ReducedBody, mechanics: BodyMechanics, edge_weight: float) -> None:
        mesh = body.mesh
        volume = sp.diags(mesh.node_volumes / mesh.node_volumes.sum())
        edges = mesh.surface_edges
        ends = np.tile([1.0, -1.0], len(edges))
        difference = sp.csr_matrix(
            (ends, (np.repeat(np.arange(len(edges)), 2), edges.ravel())), shape=(len(edges), mesh.n_nodes)
        )
        laplacian = difference.T @ difference / len(edges)
        self._volume, self._both = volume.tocsr(), (volume + edge_weight * laplacian).tocsr()
        columns = mechanics.surface_compliance.dense(), mechanics.spread_compliance.operator
        self._columns = np.concatenate(columns)
        self.volume_gamma = self._gamma(self._volume)
        self.gamma = self._gamma(self._both)

    def _gamma(self, metric: sp.csr_matrix) -> Tensor:
        n_contact, dim, n_nodes, _ = self._columns.shape
        size, metric = n_contact * dim, metric.astype(np.float32)
        gamma = np.zeros((size, size), dtype=np.float32)
        for axis in range(dim):
            # One displacement component at a time, to save memory; contiguous, for a fast matrix product.
            columns = np.ascontiguousarray(self._columns[..., axis].reshape(size, n_nodes).T)
            weighted = np.asarray(metric @ columns)
            for start in range(0, size, _PANEL):
                panel = slice(start, start + _PANEL)
                gamma[panel, start:] += columns[:, panel].T @ weighted[:, start:]
        for start in range(0, size, _PANEL):
            panel = slice(start, start + _PANEL)
            gamma[start:, panel] = gamma[panel, start:].T
        blocks = gamma.reshape(n_contact, dim, n_contact, dim).transpose(0, 2, 1, 3)
        return torch.from_numpy(np.ascontiguousarray(blocks))

    def of_field(self, field: Array, loads: IntArray) -> tuple[Array, float, Array, float]:
        """(h, c, volume_h, volume_c) of a field w (n_nodes, dim): h (m, dim) at loads (m,) and c with the edge term,
        then both without it."""
        rows = self._columns[loads].reshape(len(loads) * field.shape[1], -1)
        both, volume = self._both @ field, self._volume @ field
        weighted = np.stack([both.ravel(), volume.ravel()], axis=1).astype(np.float32)
        h, volume_h = (rows @ weighted).T.reshape(2, len(loads), -1)
        return h, float(np.vdot(field, both)), volume_h, float(np.vdot(field, volume))


def quadratic_form(blocks: Iterable[Tensor], phi: Tensor) -> Tensor:
    """phi^T Gamma phi (b,) of samples with forces phi (b, n, dim) on their loads, padded; blocks: of each, see
    `sample_blocks.py`.

    Computed as 2 phi . p - p . phi' with p = Gamma phi and phi' detached. Its derivative is 2 p, and autograd records
    no blocks of Gamma. Samples are processed one by one: the cost is quadratic in the number of nodes, and the largest
    sample has about ten times as many nodes as most.
    """
    b, n, dim = phi.shape
    product = torch.zeros_like(phi).view(b, n * dim)
    with torch.no_grad():
        flat = phi.reshape(b, n * dim)
        for k, block in enumerate(blocks):
            size = len(block)
            product[k, :size] = block @ flat[k, :size]
    product = product.view(b, n, dim)
    return (2.0 * phi * product - phi.detach() * product).sum((1, 2))
