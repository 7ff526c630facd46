"""The load model in numpy gives what the model itself gives."""

import numpy as np
import pytest
import torch

from runtime.colliders import RigidPose, Sphere
from runtime.corrections.contact_loads import ContactLoadsProbe
from runtime.corrections.load_evaluation import LoadEvaluation
from runtime.corrections.load_model import LoadModel, LoadModelOptions
from runtime.corrections.rest_mechanics import compute_rest_mechanics

STIFFNESS, BAND = 1e10, 0.004


@pytest.fixture
def contact(jelly_body, dim):
    ball = Sphere(0.02, dim, "ball")
    mechanics = compute_rest_mechanics(jelly_body, 400, False)
    rows = jelly_body.rest_rows + 1e-3 * np.random.default_rng(5).normal(size=jelly_body.rest_rows.shape)
    turned = [0.3] if dim == 2 else [0.3, -0.2, 0.5]
    pose = RigidPose.from_rotation_vector(turned, np.append(np.full(dim - 1, 0.004), 0.06 + 0.02 - 0.006))
    return ContactLoadsProbe(jelly_body, ball, mechanics, STIFFNESS, BAND).measure(rows, pose)


@pytest.mark.parametrize("activation", ["tanh", "silu", "softplus"])
# Round-off of the precision, some hundred terms long.
@pytest.mark.parametrize(("kind", "tolerance"), [(torch.float32, 1e-5), (torch.float64, 1e-13)])
def test_is_the_model(contact, jelly_body, dim, activation, kind, tolerance):
    torch.manual_seed(0)
    model = LoadModel(LoadModelOptions((16, 12), activation, 0.001, BAND, STIFFNESS), dim, jelly_body.n_rows)
    local, load, lever = (torch.from_numpy(part) for part in (contact.inputs, contact.load, contact.lever))
    with torch.no_grad():
        model.normalise(local, contact.depth * torch.tensor([0.8, 1.3]), load, lever)
        for parameter in model.parameters():
            parameter.copy_(torch.randn_like(parameter) / max(parameter.shape) ** 0.5)
        model = model.to(kind)
        depth = torch.tensor(contact.depth, dtype=torch.float64)
        expected = model(*(part.to(kind) for part in (local, depth, load, lever))).numpy()
    found = LoadEvaluation(model).loads(contact)
    assert found.dtype == expected.dtype
    assert np.abs(expected - contact.load).max() > 1e-3 * np.abs(expected).max()  # it does say something
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=tolerance * np.abs(expected).max())
