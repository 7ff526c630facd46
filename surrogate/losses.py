"""The loss of thesis 5.3.1 and the error measures by which models are compared."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from runtime.learned.thesis5.model import ContactCentricModel
from surrogate.dataset import Batch, ContactDataset


def contact_loss(model: ContactCentricModel, batch: Batch, edge_weight: float) -> Tensor:
    """L2 of the displacement over the volume plus L2 of its differences along surface edges (thesis 5.3.1).

    Both are means in units of the model's output scale; edge_weight multiplies the second.
    """
    difference = (model(batch.state, batch.shared, batch.depth) - batch.target) / model.output_scale
    n_nodes, n_edges = batch.node_weight.shape[1], batch.edge_weight.shape[1]
    at_nodes, first, second = difference.split([n_nodes, n_edges, n_edges], dim=1)
    volume = (batch.node_weight * at_nodes.square().sum(-1)).mean()
    edges = (batch.edge_weight * (first - second).square().sum(-1)).mean()
    return volume + edge_weight * edges


@dataclass(frozen=True)
class FieldError:
    """Errors of a set of samples, relative to the displacement (0: perfect; 1: no better than no correction).

    rms = sqrt(sum w |u_pred - u|^2 / sum w |u|^2) over samples and nodes, w the node volumes; worst: the
    largest of this over single samples; samples: how many.
    """

    rms: float
    worst: float
    samples: int

    @property
    def squared(self) -> float:
        """The share of the displacement's energy that is missed: rms^2."""
        return self.rms**2


@torch.no_grad()
def field_error(model: ContactCentricModel, data: ContactDataset, batch: int = 2) -> FieldError:
    """Error of a model on a data set that holds all nodes (or, estimated, on pools)."""
    missed, whole = [], []
    device = data.rows.device
    for index in torch.arange(len(data), device=device).split(batch):
        part = data.batch(index)
        n_nodes = part.node_weight.shape[1]
        difference = (model(part.state, part.shared, part.depth) - part.target)[:, :n_nodes]
        missed.append((part.node_weight * difference.square().sum(-1)).sum(1).double())
        whole.append((part.node_weight * part.target[:, :n_nodes].square().sum(-1)).sum(1).double())
    error, total = torch.cat(missed), torch.cat(whole)
    return FieldError(
        float((error.sum() / total.sum()).sqrt()), float((error / total).max().sqrt()), len(data)
    )
