"""Learning contact loads. The loss over the whole volume needs only the few loads in contact.

The field of a load model is linear in its loads phi. Pulled back to rest coordinates, with w = F^-1 u of the
truth,

    |G^T phi - w|_M^2 = phi^T Gamma phi - 2 phi^T h + c,    Gamma = G M G^T,    h = G M w,    c = w^T M w,

where M holds both terms of thesis 5.3.1: node volumes, and the graph Laplacian of the surface edges,

    w^T M w = sum_i V_i |w_i|^2 / sum V + edge_weight * sum_edges |w_a - w_b|^2 / n_edges.

Gamma belongs to the body; of each sample only h at its loads and c are kept. The loss is the mean over samples of

    |G^T phi - w|_M^2 / (c + kappa <c>),

<c> the mean of c: between errors relative to each sample's own displacement (kappa = 0) and to that of all of them.
Without the first, contacts that dent little, under thin walls, would not count, and more of them be left worse than
mechanics leaves them; without the second, those that hardly touch would count as much as all others.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.sparse as sp
import torch
from torch import Tensor
from torch.nn.utils.rnn import pad_sequence

from runtime.arrays import Array, IntArray
from runtime.body.body import ReducedBody
from runtime.colliders.collider import Collider
from runtime.errors import SoftprintError
from runtime.learned.force.confidence import squared_ratio
from runtime.learned.force.contact_state import ContactStateProbe
from runtime.learned.force.model import ForceModel, ForceModelOptions
from runtime.mechanics.body_mechanics import BodyMechanics
from runtime.mechanics.surface_compliance import SurfaceCompliance
from runtime.truth.truth_file import TruthData
from surrogate.losses import FieldError
from surrogate.tasks import seeded, some_samples
from surrogate.touching import touching_samples

# kappa. The error on validation shapes is the same as for infinity, and their shallow half comes out by a fifth better.
_SHALLOW = 0.1
# Rows of Gamma that are worked out together: only its upper half is, but for the blocks on the diagonal.
_PANEL = 1024


@dataclass(frozen=True, eq=False)
class ForceData:
    """Samples, padded to the largest number m of loads. local: (s, m, n_local); depth: (s,); load:
    (s, m, dim); lever: (s, m, DIRECTIONS, dim); index: (s, m) into the loads of the body;
    present: (s, m) 1 where there is a load; h: (s, m, dim) and squared: (s,), c, with the edge term;
    volume_h, volume_squared: without it."""

    local: Tensor
    depth: Tensor
    load: Tensor
    lever: Tensor
    index: Tensor
    present: Tensor
    h: Tensor
    squared: Tensor
    volume_h: Tensor
    volume_squared: Tensor

    def __len__(self) -> int:
        return len(self.depth)

    def to(self, device: torch.device) -> ForceData:
        """The same data on a device."""
        return ForceData(*(getattr(self, name).to(device) for name in ForceData.__dataclass_fields__))


class ForceMetric:
    """Gamma of a body, with the edge term and without: (n_loads, n_loads, dim, dim) float32."""

    def __init__(self, body: ReducedBody, compliance: SurfaceCompliance, edge_weight: float) -> None:
        mesh = body.mesh
        volume = sp.diags(mesh.node_volumes / mesh.node_volumes.sum())
        edges = mesh.surface_edges
        ends = np.tile([1.0, -1.0], len(edges))
        difference = sp.csr_matrix(
            (ends, (np.repeat(np.arange(len(edges)), 2), edges.ravel())), shape=(len(edges), mesh.n_nodes)
        )
        laplacian = difference.T @ difference / len(edges)
        self._volume, self._both = volume.tocsr(), (volume + edge_weight * laplacian).tocsr()
        self._columns = compliance.dense()
        self.volume_gamma = self._gamma(self._volume)
        self.gamma = self._gamma(self._both)

    def _gamma(self, metric: sp.csr_matrix) -> Tensor:
        n_loads, dim, n_nodes, _ = self._columns.shape
        size, metric = n_loads * dim, metric.astype(np.float32)
        gamma = np.zeros((size, size), dtype=np.float32)
        for axis in range(dim):
            # One component of the displacement at a time, for memory; contiguous, for the fast matrix product.
            columns = np.ascontiguousarray(self._columns[..., axis].reshape(size, n_nodes).T)
            weighted = np.asarray(metric @ columns)
            for start in range(0, size, _PANEL):
                panel = slice(start, start + _PANEL)
                gamma[panel, start:] += columns[:, panel].T @ weighted[:, start:]
        for start in range(0, size, _PANEL):
            panel = slice(start, start + _PANEL)
            gamma[start:, panel] = gamma[panel, start:].T
        blocks = gamma.reshape(n_loads, dim, n_loads, dim).transpose(0, 2, 1, 3)
        return torch.from_numpy(np.ascontiguousarray(blocks))

    def of_field(self, field: Array, loads: IntArray) -> tuple[Array, float, Array, float]:
        """h (m, dim) at `loads` and c, with the edge term and without, of a field w (n_nodes, dim)."""
        rows = self._columns[loads].reshape(len(loads) * field.shape[1], -1)
        both, volume = self._both @ field, self._volume @ field
        weighted = np.stack([both.ravel(), volume.ravel()], axis=1).astype(np.float32)
        h, volume_h = (rows @ weighted).T.reshape(2, len(loads), -1)
        return h, float(np.vdot(field, both)), volume_h, float(np.vdot(field, volume))


def read_force_data(
    truth: TruthData,
    body: ReducedBody,
    collider: Collider,
    mechanics: BodyMechanics,
    options: ForceModelOptions,
    metric: ForceMetric,
    samples: IntArray,
    progress: Callable[[int], None] | None = None,
) -> ForceData:
    """The given rows of a truth file. Samples in which the reduced body does not touch are dropped."""
    probe = ContactStateProbe(body, collider, mechanics, options.stiffness, options.band)
    gradient = body.node_points().basis_gradient
    state = -1
    columns: list[tuple[Tensor, ...]] = []
    for sample, rows, _pose, contact in touching_samples(truth, samples, probe, progress):
        if truth.sample_state[sample] != state:
            state = truth.sample_state[sample]
            to_rest = np.linalg.inv(rows.T @ gradient)
        u = truth.displacement(sample).astype(np.float64)
        w = (to_rest @ u[..., None])[..., 0]
        h, squared, volume_h, volume_squared = metric.of_field(w, contact.index)
        columns.append(
            (
                torch.from_numpy(contact.inputs).float(),
                torch.tensor(contact.depth),
                torch.from_numpy(contact.load).float(),
                torch.from_numpy(contact.lever).float(),
                torch.from_numpy(contact.index),
                torch.ones(len(contact.index)),
                torch.from_numpy(h).float(),
                torch.tensor(squared),
                torch.from_numpy(volume_h).float(),
                torch.tensor(volume_squared),
            )
        )
    if not columns:
        raise SoftprintError(
            f"{truth.path}: none of the {len(samples)} samples asked for touches the reduced body"
        )
    names = list(ForceData.__dataclass_fields__)
    whole = {"depth", "squared", "volume_squared"}
    stacked = (
        torch.stack(column).float() if name in whole else pad_sequence(list(column), batch_first=True)
        for name, column in zip(names, zip(*columns, strict=True), strict=True)
    )
    return ForceData(*stacked)


class ForceTask:
    """A `ForceModel`, learned from `ForceData`."""

    def __init__(
        self,
        options: ForceModelOptions,
        metric: ForceMetric,
        data: ForceData,
        validation: ForceData,
        n_rows: int,
    ) -> None:
        self._options, self._data, self._validation, self._n_rows = options, data, validation, n_rows
        self._gamma = metric.gamma.to(self.device)
        self._volume_gamma = metric.volume_gamma.to(self.device)
        weight = 1.0 / (data.squared + _SHALLOW * data.squared.mean())
        self._weight = weight / (weight * data.squared).mean()

    @property
    def n_samples(self) -> int:
        return len(self._data)

    @property
    def device(self) -> torch.device:
        return self._data.depth.device

    @property
    def identity(self) -> dict[str, Any]:
        return {"form": "loads", **self._options.to_json()}

    def fresh_model(self, seed: int) -> ForceModel:
        """Initial weights from the seed, normalisation from the data."""
        data, dim = self._data, self._data.load.shape[-1]
        model = seeded(lambda: ForceModel(self._options, dim, self._n_rows), seed).to(self.device)
        some = some_samples(len(data), seed, self.device)
        there = data.present[some] > 0
        model.normalise(data.local[some][there], data.depth, data.load[some][there], data.lever[some][there])
        model.trust.span(model.normalised(data.local[data.present > 0]))
        return model

    def loss(self, model: ForceModel, index: Tensor) -> Tensor:
        """The weighted mean of the squared error in the norm M, in units of that of the displacement."""
        missed, _ = self._missed(model, self._data, index, self._gamma, volume_only=False)
        return (missed * self._weight[index]).mean()

    @torch.no_grad()
    def held_out_error(self, model: ForceModel, batch: int = 64) -> FieldError:
        """Over the volume of the validation samples, the fields pulled back to rest coordinates."""
        data = self._validation
        parts = [
            self._missed(model, data, index, self._volume_gamma, volume_only=True)
            for index in torch.arange(len(data), device=self.device).split(batch)
        ]
        missed, whole = (torch.cat(column).double() for column in zip(*parts, strict=True))
        return FieldError(
            float((missed.sum() / whole.sum()).clamp(min=0.0).sqrt()),
            float((missed / whole).max().clamp(min=0.0).sqrt()),
            len(data),
        )

    @torch.no_grad()
    def finish(self, model: ForceModel, batch: int = 256) -> None:
        """No contact is to be corrected much more than those learned from were."""
        data = self._data
        ratios = []
        for part in torch.arange(len(data), device=self.device).split(batch):
            load = data.load[part]
            correction = model.correction(data.local[part], data.depth[part], load, data.lever[part])
            ratios.append(squared_ratio(load, correction).sqrt())
        model.trust.limit(torch.cat(ratios))

    @staticmethod
    def _missed(
        model: ForceModel, data: ForceData, index: Tensor, gamma: Tensor, volume_only: bool
    ) -> tuple[Tensor, Tensor]:
        """Squared error and squared displacement (b,) of samples `index`."""
        count = data.present[index].sum(1).long()
        m = int(count.max())
        loads, present = data.index[index, :m], data.present[index, :m, None]
        lever = data.lever[index, :m]
        phi = model(data.local[index, :m], data.depth[index], data.load[index, :m], lever) * present
        h, c = (data.volume_h, data.volume_squared) if volume_only else (data.h, data.squared)
        quadratic = quadratic_form(gamma, loads, count, phi)
        return quadratic - 2.0 * (phi * h[index, :m]).sum((1, 2)) + c[index], c[index]


def quadratic_form(gamma: Tensor, loads: Tensor, count: Tensor, phi: Tensor) -> Tensor:
    """phi^T Gamma phi (b,) of the first `count` (b,) of the loads (b, m) of every sample, with phi (b, m, dim); as
    2 phi . p - p . phi' with p = Gamma phi and phi' held, whose derivative is 2 p, without a tape of blocks of Gamma.

    Sample by sample: the largest has some ten times as many loads as most, and the cost is in the squares.
    """
    pressed = torch.zeros_like(phi)
    with torch.no_grad():
        for k, m in enumerate(count.tolist()):
            block = gamma[loads[k, :m, None], loads[k, :m]]
            pressed[k, :m] = torch.einsum("xyij,yj->xi", block, phi[k, :m])
    return (2.0 * phi * pressed - phi.detach() * pressed).sum((1, 2))
