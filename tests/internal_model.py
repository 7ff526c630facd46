"""Internal corrections of any body: with random weights, quadratic, and of modes in equilibrium."""

import numpy as np
import torch
from numpy.typing import NDArray

from softprint.runtime.body import ReducedBody
from softprint.runtime.learned.internal.model import (
    InternalModel,
    InternalOptions,
    ModesModel,
    ModesOptions,
    QuadraticModel,
    QuadraticOptions,
)


def made_model(
    body: ReducedBody, on_condensation: bool = False, size: float = 1e-3, gravity: tuple[float, ...] = ()
) -> InternalModel:
    """Random weights, smooth components, and corrections of about this size [m]; none in the frames."""
    options = InternalOptions((12, 12), 4, True, on_condensation, gravity)
    model = InternalModel(options, body.dim, body.n_rows, body.n_nodes)
    generator = torch.Generator().manual_seed(2)
    for parameter in model.parameters():
        parameter.data = 0.4 * torch.randn(parameter.shape, generator=generator)
    model.modes.copy_(_waves(body))
    model.coefficient_scale.fill_(size)
    model.input_scale.fill_(0.01)
    if gravity:
        model.input_scale[-body.dim :] = 1.0
    model.linear.copy_(0.1 * torch.randn(model.linear.shape, generator=generator))
    return model


def made_quadratic(body: ReducedBody, gravity: tuple[float, ...] = ()) -> QuadraticModel:
    """Random coefficients in six directions, and corrections of about a millimetre; none in the frames."""
    options = QuadraticOptions(4, 6, False, gravity)
    model = QuadraticModel(options, body.dim, body.n_rows, body.n_nodes)
    generator = torch.Generator().manual_seed(2)

    def random(like: torch.Tensor, size: float) -> torch.Tensor:
        return size * torch.randn(like.shape, generator=generator)

    model.modes.copy_(_waves(body))
    model.directions.copy_(random(model.directions, 30.0))
    model.linear.copy_(random(model.linear, 1e-3))
    half = random(model.quadratic, 1e-3)
    model.quadratic.copy_(half + half.transpose(1, 2))
    if gravity:
        model.offset.copy_(random(model.offset, 1e-3))
    return model


def _waves(body: ReducedBody) -> torch.Tensor:
    """Four smooth components (4, n_nodes, dim), zero in the frames."""
    waves = np.array([np.sin((40.0 + 10.0 * k) * body.mesh.points) for k in range(4)])
    waves[:, body.handles.frame_nodes] = 0.0
    return torch.from_numpy(waves)


def made_modes(
    body: ReducedBody, gravity: tuple[float, ...] = (), modes: NDArray[np.float64] | None = None
) -> ModesModel:
    """Modes (K, n_nodes, dim), smooth waves by default; none in the frames; without an estimate of amplitudes."""
    if modes is None:
        along = np.linspace(1.0, 2.0, body.dim)
        modes = np.array([np.sin((60.0 + 15.0 * k) * body.mesh.points * along) for k in range(6)])
        modes[:, body.handles.frame_nodes] = 0.0
        modes = np.linalg.svd(modes.reshape(6, -1), full_matrices=False)[2].reshape(modes.shape)
    model = ModesModel(ModesOptions(len(modes), gravity), body.dim, body.n_rows, body.n_nodes)
    model.modes = torch.from_numpy(modes)
    return model
