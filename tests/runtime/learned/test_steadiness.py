"""Where the smoothed gradient vanishes, normals are discontinuous, but the displacement is continuous."""

from __future__ import annotations

import numpy as np
import pytest

from softprint.runtime.body import ReducedBody
from softprint.runtime.colliders import RigidPose, Sphere
from softprint.runtime.learned.thesis6.correction import BoundDescriptorCorrection, DescriptorCorrection
from softprint.runtime.learned.thesis6.descriptors import DirectGeometry, GridGeometry
from softprint.runtime.learned.thesis6.descriptors.steadiness import FAINT, steadiness, steadiness_slope
from tests.runtime.learned.test_corrections import DIFFERENCES, make_correction, pressed_pose


def gradients(dim: int) -> np.ndarray:
    """From zero to beyond FAINT, along one direction."""
    along = np.arange(1.0, dim + 1.0)
    return np.linspace(0.0, 1.5 * FAINT, 301)[:, None] * along / np.linalg.norm(along)


def test_factor_is_one_except_where_the_gradient_is_small(dim):
    g = gradients(dim)
    b, length = steadiness(g), np.linalg.norm(g, axis=1)
    assert b[0] == 0.0
    assert (b[length >= FAINT] == 1.0).all()
    # A step of FAINT / 200, at most 15/8 / FAINT steep.
    assert (np.diff(b) >= 0.0).all()
    assert np.diff(b).max() < 1.9 / 200
    # b over |g|, by which dn/dz is multiplied, goes to zero with |g|^2.
    assert (b[1:11] / length[1:11]).max() < 10 * (10 / 200) ** 2 / FAINT


def test_factor_has_its_derivative(dim):
    rng = np.random.default_rng(1)
    g, slope = gradients(dim), rng.normal(size=(301, dim, dim))
    along, step = rng.normal(size=dim), 1e-6
    change = steadiness(g + step * slope @ along) - steadiness(g - step * slope @ along)
    # (step / FAINT)^2 of curvature, times derivatives of some hundred over FAINT; the third one jumps at FAINT.
    assert np.allclose(change / (2 * step), steadiness_slope(g, slope) @ along, atol=1e-5)


def pressed_to_its_middle(body: ReducedBody, kind: str) -> tuple[BoundDescriptorCorrection, int, RigidPose]:
    """A ball with its centre, where its smoothed gradient is zero, at a node."""
    ball = Sphere(0.02, body.dim, name="ball")
    model = make_correction("descriptor", body, {}).model
    make = DirectGeometry if kind == "direct" else GridGeometry
    geometry = make(ball, model.options.radius, model.options.sets)
    pose, points = pressed_pose(body), body.mesh.points
    node = int(np.linalg.norm(points - pose.translation, axis=1).argmin())
    bound = DescriptorCorrection("x", model, body, ball, geometry).bind(body.node_points())
    return bound, node, RigidPose(pose.rotation, points[node])


@pytest.mark.parametrize("kind", ["direct", "grid"])
def test_displacement_is_continuous_where_normals_are_not(kind, jelly_body):
    body, rows = jelly_body, jelly_body.rest_rows
    bound, node, pose = pressed_to_its_middle(body, kind)
    along = np.arange(1.0, body.dim + 1.0) / np.linalg.norm(np.arange(1.0, body.dim + 1.0))
    ways = np.linspace(-4e-3, 4e-3, 401)
    u = np.stack(
        [
            bound.displacement(rows, RigidPose(pose.rotation, pose.translation + way * along))[node]
            for way in ways
        ]
    )
    size, step = np.linalg.norm(u, axis=1), np.linalg.norm(np.diff(u, axis=0), axis=1)
    # The displacement on the other side differs by more than its size, and vanishes in between.
    assert np.linalg.norm(u[0] - u[-1]) > size.max()
    assert size.min() < 1e-9 * size.max()
    # A step of 20 um, where |g| comes to FAINT within 0.7 mm and b is 15/8 as steep as that: a twentieth. Without b it
    # is more than the whole.
    assert step.max() < 0.08 * size.max()


@pytest.mark.parametrize("kind", ["direct", "grid"])
def test_derivatives_are_correct_near_it(kind, jelly_body):
    body, rows, step = jelly_body, jelly_body.rest_rows, 1e-7
    bound, node, pose = pressed_to_its_middle(body, kind)
    direction = np.random.default_rng(4).standard_normal(rows.shape)
    for off in (1e-5, 2e-4, 7e-4):
        beside = RigidPose(pose.rotation, pose.translation + off)
        field = bound.linearise(rows, beside)
        by_hand = np.einsum("arb,rb->a", field.jacobian[field.index == node][0], direction)
        up, down = (bound.displacement(rows + s * direction, beside)[node] for s in (step, -step))
        # Quantities that vary over the distance from the point are accurate to (step / off)^2.
        tolerance = (step / off) ** 2 * np.abs(by_hand).max() + DIFFERENCES * max(np.abs(by_hand).max(), 1.0)
        assert np.abs((up - down) / (2 * step) - by_hand).max() < tolerance
