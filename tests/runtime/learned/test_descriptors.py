"""Contact frames and local descriptors: exactness, invariance, derivatives, and continuity at distance d."""

from __future__ import annotations

from itertools import product
from math import gamma

import numpy as np
import pytest
import torch

from softprint.runtime.body import ReducedBody
from softprint.runtime.colliders import Box, Plane, RigidPose, Sphere
from softprint.runtime.colliders.combine import Placed
from softprint.runtime.errors import SoftprintError
from softprint.runtime.learned.thesis6.correction import DescriptorCorrection
from softprint.runtime.learned.thesis6.descriptors import (
    DirectGeometry,
    GridGeometry,
    LocalDescriptor,
    SmoothedGradient,
    ball_rule,
    biased_frames,
    handle_spacing,
    moving_frames,
    random_frames,
    sample_pattern,
)
from softprint.runtime.learned.thesis6.descriptors.attenuation import attenuation, attenuation_slope
from softprint.runtime.learned.thesis6.descriptors.smoothed_gradient import unit_normal_slope
from softprint.runtime.learned.thesis6.model import DescriptorModel, DescriptorModelOptions
from tests.runtime.learned.test_corrections import bent_rows, pressed_pose, random_weights

RADIUS, SETS = 0.03, 8
# Central differences with a step of 1e-6 m, of functions that vary over centimetres, in float64.
DIFFERENCES = 1e-6


def box(dim: int) -> Box:
    return Box([0.02, 0.015, 0.01][:dim], 0.003, "box")


def around(dim: int, count: int = 40) -> np.ndarray:
    """Points within d of the box of `box`."""
    return np.random.default_rng(1).uniform(-0.03, 0.03, (count, dim))


def rigid_motion(dim: int) -> RigidPose:
    return RigidPose.from_rotation_vector([1.1] if dim == 2 else [0.8, -0.3, 0.5], np.linspace(0.1, 0.3, dim))


def directions(dim: int, count: int = 500) -> np.ndarray:
    n = np.random.default_rng(2).standard_normal((count, dim))
    return n / np.linalg.norm(n, axis=1, keepdims=True)


def monomial_integral(powers: tuple[int, ...]) -> float:
    """Of x^a y^b z^c over the unit ball (Folland 2001)."""
    if any(power % 2 for power in powers):
        return 0.0
    halves = [0.5 * (power + 1) for power in powers]
    return 2 * np.prod([gamma(half) for half in halves]) / gamma(sum(halves)) / (sum(powers) + len(powers))


def test_rule_integrates_degree_seven(dim):
    points, weights = ball_rule(dim)
    assert len(points) == {2: 16, 3: 64}[dim]
    assert (np.linalg.norm(points, axis=1) < 1.0).all()
    for powers in product(range(8), repeat=dim):
        if sum(powers) <= 7:
            # Round-off of a few dozen terms of order one.
            assert weights @ np.prod(points**powers, axis=1) == pytest.approx(
                monomial_integral(powers), abs=1e-14
            )
    assert weights @ points[:, 0] ** 8 != pytest.approx(monomial_integral((8,) + (0,) * (dim - 1)), rel=1e-3)


def test_pattern_repeats_about_the_normal():
    """A rotation by an eighth about the first axis permutes the samples: descriptors of axisymmetric shapes are
    equal."""
    pattern = sample_pattern(3)
    c = np.sqrt(0.5)
    rotated = pattern @ np.array([[1, 0, 0], [0, c, -c], [0, c, c]])
    gaps = np.linalg.norm(rotated[:, None] - pattern[None], axis=2)
    assert gaps.min(axis=1).max() < 1e-15


@pytest.mark.parametrize("sets", [0, SETS])
def test_smoothed_gradient_of_a_plane_is_its_normal(dim, sets):
    normal = directions(dim, 1)[0]
    smoothed = SmoothedGradient(Plane(normal, "ground"), RADIUS, sets)
    # Differences of a linear function are exact up to round-off, over a step of a few tenths of a millimetre.
    assert np.allclose(smoothed.value(around(dim)), normal, atol=1e-11)


def test_smoothed_normal_of_a_ball_points_outward(dim):
    """By symmetry, up to the error of a finite number of differences."""
    n = directions(dim, 50)
    found = DirectGeometry(Sphere(0.02, dim), RADIUS, 400).normal(0.03 * n)
    assert (found * n).sum(axis=1).min() > 0.99


def test_smoothing_removes_the_jump_of_the_normal_across_an_edge():
    """Across the diagonal of a sharp corner the raw gradient rotates by a right angle within a cell; the smoothed one
    only by the angle of an arc over d."""
    corner = Box([0.02, 0.02], 1e-5, "corner")
    beside = np.array([[0.018, 0.018 + s] for s in (-2e-4, 2e-4)])
    raw, smooth = (DirectGeometry(corner, RADIUS, sets).normal(beside) for sets in (0, 32))
    assert raw[0] @ raw[1] < 0.1
    assert smooth[0] @ smooth[1] > 0.99


@pytest.mark.parametrize("kind", ["direct", "grid"])
def test_frames_and_descriptors_have_their_derivatives(dim, kind):
    make = DirectGeometry if kind == "direct" else GridGeometry
    geometry, descriptor = make(box(dim), RADIUS, SETS), LocalDescriptor(dim, RADIUS)
    z, step = around(dim), 1e-6
    along = directions(dim, len(z))

    def at(points):
        return [
            (frames, descriptor.derivatives(geometry, points[frames.at], frames.rotation, frames.slope))
            for frames in moving_frames(*unit_normal_slope(*geometry.smoothed_derivatives(points)))
        ]

    for (frames, (_, slope)), (up, (above, _)), (down, (below, _)) in zip(
        at(z), at(z + step * along), at(z - step * along), strict=True
    ):
        assert np.array_equal(up.at, down.at)
        v = along[frames.at]
        # Normals rotate by up to 1/|g| per d, a few hundred radians per metre.
        for change, by_hand in (
            (up.rotation - down.rotation, np.einsum("nabc,nc->nab", frames.slope, v)),
            (up.weight - down.weight, np.einsum("nc,nc->n", frames.weight_slope, v)),
            (above - below, np.einsum("nmc,nc->nm", slope, v)),
        ):
            assert np.abs(change / (2 * step) - by_hand).max() < DIFFERENCES * max(np.abs(by_hand).max(), 1.0)


def test_frames_are_rotations_and_blend_without_a_jump(dim):
    n = directions(dim)
    total = np.zeros(len(n))
    for frames in biased_frames(n):
        R = frames.rotation
        assert np.allclose(R.transpose(0, 2, 1) @ R, np.eye(dim), atol=1e-14)
        assert np.allclose(np.linalg.det(R), 1.0)
        assert np.allclose(R[:, :, 0], n[frames.at])
        total[frames.at] += frames.weight
    assert np.allclose(total, 1.0, atol=1e-15)
    assert np.allclose(random_frames(n, np.random.default_rng(0))[:, :, 0], n)


def test_tangents_do_not_flicker_where_a_bias_fails():
    """A normal that passes (1, 0, 0): vectors built in the frames vary as smoothly as the normal."""
    angle = np.linspace(-0.6, 0.6, 1001)
    n = np.column_stack([np.cos(angle), np.sin(angle) + 1e-9, np.full(1001, 1e-9)])
    n /= np.linalg.norm(n, axis=1, keepdims=True)
    blended = np.zeros((len(n), 3))
    for frames in biased_frames(n):
        blended[frames.at] += frames.weight[:, None] * frames.rotation[:, :, 1]
    # A step is 1.2e-3 rad, and weights change over some tenths of a radian; the first bias alone flips t1 by 2.
    assert np.abs(np.diff(blended, axis=0)).max() < 0.02


def test_descriptors_of_planes_balls_and_boxes_are_their_distances(dim):
    z, pattern = around(dim), sample_pattern(dim)
    for collider in (Plane(directions(dim, 1)[0], "plane"), Sphere(0.02, dim), box(dim)):
        geometry = DirectGeometry(collider, RADIUS, SETS)
        R = biased_frames(geometry.normal(z))[0]
        there = z[R.at]
        found = LocalDescriptor(dim, RADIUS).values(geometry, there, R.rotation)
        for sample, w in enumerate(pattern):
            exact = collider.sdf(there + RADIUS * np.einsum("nab,b->na", R.rotation, w))
            assert np.allclose(found[:, sample], exact, atol=1e-15)
    # On a plane only the height matters: phi_i = phi + d w_i . n.
    ground = Plane(np.eye(dim)[-1], "ground")
    geometry = DirectGeometry(ground, RADIUS, SETS)
    frames = biased_frames(geometry.normal(z))[0]
    found = LocalDescriptor(dim, RADIUS).values(geometry, z[frames.at], frames.rotation)
    # The normal is exact up to round-off, see above.
    assert np.allclose(found, z[frames.at, -1:] + RADIUS * pattern[:, 0], atol=1e-12)


def test_samples_are_those_of_the_thesis():
    """64 and the centre; half of them; the centre."""
    assert [len(LocalDescriptor(3, RADIUS, samples)) for samples in ("all", "half", "one")] == [65, 33, 1]


def test_raw_frames_turn_with_the_collider(dim):
    """A collider that is rotated and moved in its own coordinates has, at points moved along, the same descriptor in
    frames moved along."""
    pose, z = rigid_motion(dim), around(dim)
    still, moved = (DirectGeometry(c, RADIUS, 0) for c in (box(dim), Placed(box(dim), pose)))
    descriptor = LocalDescriptor(dim, RADIUS)
    R = random_frames(still.normal(z), np.random.default_rng(5))
    before = descriptor.values(still, z, R)
    after = descriptor.values(moved, pose.apply(z), pose.rotation @ R)
    assert np.allclose(moved.normal(pose.apply(z)), pose.rotate(still.normal(z)), atol=1e-12)
    assert np.allclose(after, before, atol=1e-14)


def test_grids_agree_with_the_collider(dim):
    direct, grid = DirectGeometry(box(dim), RADIUS, SETS), GridGeometry(box(dim), RADIUS, SETS)
    z = around(dim, 400)
    # Cells of 1.6 mm round the kinks of the medial axis by a share of their width; the normal is that of a field
    # smoothed over 30 mm, on cells of 4.
    assert np.abs(grid.distance(z) - direct.distance(z)).max() < 4e-4
    strong = np.linalg.norm(SmoothedGradient(box(dim), RADIUS, SETS).value(z), axis=1) > 0.1
    assert (grid.normal(z) * direct.normal(z)).sum(axis=1)[strong].min() > 0.995


def test_attenuation_is_continuous_at_d():
    s = np.linspace(-0.01, 2 * RADIUS, 2001)
    a, slope = attenuation(s, RADIUS), attenuation_slope(s, RADIUS)
    assert (a[s <= 0] == 1.0).all()
    assert (a[s >= RADIUS] == 0.0).all()
    # A step of 35 um; over the outer half of d the slope is at most 3 / d, and its derivative 24 / d^2.
    assert np.abs(np.diff(a)).max() < 36e-6 * 3 / RADIUS
    assert np.abs(np.diff(slope)).max() < 36e-6 * 24 / RADIUS**2
    # The mean of both ends misses the mean slope by at most a quarter of what the slope changes over a step.
    assert np.abs(np.diff(a) / np.diff(s) - 0.5 * (slope[1:] + slope[:-1])).max() < 36e-6 * 6 / RADIUS**2


def correction(body: ReducedBody, radius: float = RADIUS) -> DescriptorCorrection:
    options = DescriptorModelOptions((16, 12), "elu", radius, SETS, "all", 5e-4)
    model = DescriptorModel(options, body.dim, body.n_rows)
    random_weights(model, 3)
    model.scale.fill_(0.03)
    model.output_scale.fill_(1e-3)
    return DescriptorCorrection("x", model.double(), body, box(body.dim))


def test_displacement_ends_smoothly_at_d(jelly_body):
    """The displacement of nodes vanishes before they leave the neighbourhood of the collider."""
    body, radius = jelly_body, 0.02
    bound = correction(body, radius).bind(body.node_points())
    rows, pose = body.rest_rows, pressed_pose(body)
    u = np.linalg.norm(bound.displacement(rows, pose), axis=1)
    distance = box(body.dim).sdf(pose.apply_inverse(body.reduced_positions(rows)))
    assert u[distance > radius].max() == 0.0
    edge = (distance > 0.9 * radius) & (distance < radius)
    assert edge.any()
    assert u.max() > 0.0
    # 0.9 d is four fifths along the attenuation: 10 % of the displacement without attenuation.
    assert u[edge].max() < 0.1 * u.max()


def test_one_point_agrees_with_a_batch(jelly_body):
    body = jelly_body
    given, rows, pose = correction(body), bent_rows(body), pressed_pose(body)
    everywhere = given.bind(body.node_points()).linearise(rows, pose)
    for slot in np.argsort(-np.linalg.norm(everywhere.displacement, axis=1))[:5]:
        alone = given.bind(body.node_points(everywhere.index[[slot]])).linearise(rows, pose)
        # Matrix products of other shapes add up in another order.
        assert np.allclose(alone.displacement[0], everywhere.displacement[slot], atol=1e-15)
        assert np.allclose(alone.jacobian[0], everywhere.jacobian[slot], atol=1e-12)


def test_radius_is_the_spacing_of_handles(jelly_body):
    places = np.vstack(
        [jelly_body.mesh.points[jelly_body.handles.points], [f.pivot for f in jelly_body.handles.frames]]
    )
    gaps = np.linalg.norm(places[:, None] - places[None], axis=2) + np.diag(np.full(len(places), np.inf))
    assert handle_spacing(jelly_body) == pytest.approx(gaps.min(axis=1).mean())


def test_colliders_without_bounds_are_refused(jelly3d_body):
    options = DescriptorModelOptions((4,), "elu", RADIUS, SETS, "all", 5e-4)
    model = DescriptorModel(options, 3, jelly3d_body.n_rows)
    with pytest.raises(SoftprintError, match="has no bounds"):
        DescriptorCorrection("x", model, jelly3d_body, Plane([0, 0, 1], "ground"))
    with pytest.raises(SoftprintError, match="train it for this body"):
        DescriptorCorrection("x", DescriptorModel(options, 2, 3), jelly3d_body, Sphere(0.02, 3))


def test_network_slope_of_elu_is_its_derivative():
    options = DescriptorModelOptions((6, 5), "elu", RADIUS, SETS, "one", 5e-4)
    model = DescriptorModel(options, 3, 2).double()
    random_weights(model, 1)
    inputs = torch.from_numpy(np.random.default_rng(0).standard_normal((4, 7)))
    _, jacobian = model.derivatives(inputs.numpy())
    for row in range(4):
        automatic = torch.autograd.functional.jacobian(model, inputs[row : row + 1])[0, :, 0]
        assert np.allclose(jacobian[row], automatic.numpy(), atol=1e-14)
