"""The loss of thesis 5.3.1, and the error on held-out states."""

from __future__ import annotations

import torch
from torch import Tensor

from softprint.runtime.learned.thesis5.model import ContactCentricModel
from softprint.surrogate.learning_task import HeldOutError
from softprint.surrogate.thesis5.data import Batch, ContactDataset


def contact_loss(model: ContactCentricModel, batch: Batch, edge_weight: float) -> Tensor:
    """L2 error of the displacement over the volume plus L2 error of its differences along surface edges (thesis 5.3.1).

    Both are means in units of the model's output scale; edge_weight multiplies the second.
    """
    difference = (model(batch.state, batch.shared, batch.depth) - batch.target) / model.output_scale
    n_nodes, n_edges = batch.node_weight.shape[1], batch.edge_weight.shape[1]
    at_nodes, first, second = difference.split([n_nodes, n_edges, n_edges], dim=1)
    volume = (batch.node_weight * at_nodes.square().sum(-1)).mean()
    edges = (batch.edge_weight * (first - second).square().sum(-1)).mean()
    return volume + edge_weight * edges


@torch.no_grad()
def held_out_error(model: ContactCentricModel, data: ContactDataset, batch: int = 2) -> HeldOutError:
    """Error of a model on a data set of all nodes (or an estimate of it, on a data set of pools)."""
    squares, whole = [], []
    device = data.rows.device
    for index in torch.arange(len(data), device=device).split(batch):
        part = data.batch(index)
        n_nodes = part.node_weight.shape[1]
        difference = (model(part.state, part.shared, part.depth) - part.target)[:, :n_nodes]
        squares.append((part.node_weight * difference.square().sum(-1)).sum(1).double())
        whole.append((part.node_weight * part.target[:, :n_nodes].square().sum(-1)).sum(1).double())
    return HeldOutError.of(torch.cat(squares), torch.cat(whole))
