"""Contacts keep clear of rigid frames: by how the collider is turned, else by how deep it goes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from softprint.fem_truth.sampling.contact_approach import ContactApproaches, DepthLimits
from softprint.fem_truth.sampling.contact_plan import ContactPlan
from softprint.fem_truth.sampling.rotations import random_rotation
from softprint.runtime.body import assemble_body, frame_in_box, place_handles
from softprint.runtime.body.body import ReducedBody
from softprint.runtime.colliders import Box, Sphere
from softprint.runtime.colliders.approach import Approach, OutOfReach
from softprint.runtime.colliders.collider import Collider
from softprint.runtime.colliders.pose import RigidPose
from softprint.runtime.elasticity.materials import make_material
from softprint.runtime.mesh import box_mesh
from softprint.runtime.mesh.facet_lattice import facet_lattice

DEPTH = 0.01


@pytest.fixture(scope="module", params=[2, 3])
def block(request: pytest.FixtureRequest) -> ReducedBody:
    """100 mm wide and high, held in its lowest 10 mm."""
    dim = request.param
    mesh = box_mesh((-0.05,) * (dim - 1) + (0.0,), (0.05,) * (dim - 1) + (0.1,), (10,) * dim)
    frame = frame_in_box(mesh, "base", [[-1.0] * dim, [1.0] * (dim - 1) + [0.012]])
    handles = place_handles(mesh, 5, [frame])
    return assemble_body(mesh, handles, make_material("linear", 1e4, 0.3), 1000.0, name="block")


def approaches(
    body: ReducedBody, collider: Collider, height: float, turned: bool = True, seed: int = 0
) -> ContactApproaches:
    """One contact, at the middle of a side, at a height [m]; planned as the collider stands."""
    aim = np.zeros(body.dim)
    aim[0], aim[-1] = 0.05, height
    nodes = body.mesh.surface_nodes
    place = nodes[np.argmin(np.linalg.norm(body.mesh.points[nodes] - aim, axis=1))]
    return ContactApproaches(
        body=body,
        colliders=[lambda: collider],
        plan=ContactPlan(1, (1,), 1, 1, 0.0, seed),
        internal=body.mesh.points[None],
        places=np.array([[place]]),
        rotations=np.eye(body.dim)[None] if turned else None,
        max_depth=DEPTH,
        on_facets=True,
    )


def into_the_frame(found: ContactApproaches, approach: Approach, depth: float) -> float:
    """How deep nodes of the frame are in the collider at a depth [m]."""
    (pose,) = approach.poses_at(np.array([depth]))
    frame = found.body.mesh.points[
        np.intersect1d(found.body.handles.frame_nodes, found.body.mesh.surface_nodes)
    ]
    return -float(approach.collider.sdf(pose.apply_inverse(frame)).min())


@pytest.mark.parametrize("dim", [2, 3])
def test_a_ball_meets_a_point_beside_the_place_where_geometry_says(dim: int) -> None:
    radius, beside, below = 0.03, 0.02, 0.004
    place, normal = np.zeros(dim), np.eye(dim)[-1]
    frame = beside * np.eye(dim)[0] - below * normal
    approach = Approach(Sphere(radius, dim=dim), np.stack([place, frame]), place, normal, np.eye(dim))
    exact = radius + below - np.sqrt(radius**2 - beside**2)
    # 1e-9 m: the root finder's tolerance is 1e-12 sizes of the collider.
    assert approach.meets(frame[None], 0.02) == pytest.approx(exact, abs=1e-9)
    assert approach.meets(frame[None], exact - 1e-6) == np.inf
    assert approach.meets(np.empty((0, dim)), 0.02) == np.inf


@pytest.mark.parametrize("seed", range(5))
def test_a_bar_is_turned_away_from_the_frame(block: ReducedBody, seed: int) -> None:
    # Upright, a bar of 80 mm that is aimed 50 mm above the floor presses on the base.
    bar = Box(np.array([0.004] * (block.dim - 1) + [0.044]))
    found = approaches(block, bar, 0.05, seed=seed)
    approach, limits = found.of(found.plan[0])
    assert limits.deepest == DEPTH or limits.deepest == limits.thickness
    assert into_the_frame(found, approach, limits.deepest) <= 0.0
    again, _ = found.of(found.plan[0])
    np.testing.assert_array_equal(again.rotation, approach.rotation)


def test_a_collider_that_no_frame_is_in_the_way_of_keeps_the_rotation_that_is_planned(
    block: ReducedBody,
) -> None:
    found = approaches(block, Box(np.full(block.dim, 0.02), 0.002), 0.07)
    approach, limits = found.of(found.plan[0])
    assert limits.frame == np.inf
    np.testing.assert_array_equal(approach.rotation, next(iter(found._rotations(found.plan[0]))))


def test_where_no_rotation_is_clear_of_the_frame_it_is_the_one_that_gets_deepest(block: ReducedBody) -> None:
    # 20 mm above the floor a square of 40 mm meets the base, however it is turned.
    found = approaches(block, Box(np.full(block.dim, 0.02), 0.002), 0.02)
    approach, limits = found.of(found.plan[0])
    tried = [found._turned(found.plan[0], rotation) for rotation in found._rotations(found.plan[0])]
    frames = [each.frame for _, each in tried]
    assert max(frames) < limits.without_frames
    assert limits.frame == max(frames) > min(frames)
    np.testing.assert_array_equal(approach.rotation, tried[int(np.argmax(frames))][0].rotation)


def test_without_rotations_a_contact_ends_where_the_frame_begins(block: ReducedBody) -> None:
    ball = Sphere(0.04, dim=block.dim)
    found = approaches(block, ball, 0.04, turned=False)
    approach, limits = found.of(found.plan[0])
    # The base ends 10 mm above the floor, 30 mm below the place.
    exact = 0.04 - np.sqrt(0.04**2 - 0.03**2)
    assert exact > DEPTH
    assert limits.deepest == DEPTH
    found = approaches(block, ball, 0.03, turned=False)
    approach, limits = found.of(found.plan[0])
    exact = 0.04 - np.sqrt(0.04**2 - 0.02**2)  # 5.4 mm
    assert limits.deepest == pytest.approx(exact, abs=1e-9)
    assert into_the_frame(found, approach, limits.deepest) == pytest.approx(0.0, abs=1e-9)
    limits.require_depth(approach)


def test_a_contact_that_only_presses_the_frame_is_out_of_reach_and_says_why(block: ReducedBody) -> None:
    found = approaches(block, Box(np.full(block.dim, 0.03)), 0.03, turned=False)
    approach, limits = found.of(found.plan[0])
    assert limits.frame == pytest.approx(0.0, abs=1e-9)
    with pytest.raises(
        OutOfReach, match=r"meets a rigid frame, which does not give way, when it is \S+ m deep"
    ):
        limits.require_depth(approach)


@pytest.mark.parametrize("seed", range(4))
def test_the_box_about_a_collider_touches_what_it_contains_on_the_way(seed: int) -> None:
    rng = np.random.default_rng(seed)
    collider, rotation = Box(np.array([0.03, 0.01, 0.02])), random_rotation(3, rng)
    rotation = rotation if seed else np.eye(3)  # then the line runs along two pairs of faces
    normal = np.array([0.0, 0.0, 1.0])
    nodes = np.vstack([np.zeros(3), rng.uniform(-0.05, 0.0, (20, 3))])
    approach = Approach(collider, nodes, nodes[0], normal, rotation)
    centres, radii = rng.uniform(-0.06, 0.06, (400, 3)), rng.uniform(0.0, 0.01, 400)
    (end,) = approach.poses_at(np.array([0.005]))
    heights = np.linspace(end.translation[2], 0.2, 4000)  # from beyond all balls
    shifted = [RigidPose(rotation, s * normal).apply_inverse(centres) for s in heights]
    grown = np.array([0.03, 0.01, 0.02]) + radii[:, None]
    touched = np.any([(np.abs(points) <= grown).all(axis=1) for points in shifted], axis=0)
    found = approach.reached_on_the_way(centres, radii, 0.005)
    # Poses that are 0.05 mm apart may pass a corner that is only grazed.
    assert not (touched & ~found).any()
    assert (found & ~touched).sum() <= 2
    assert 20 < found.sum() < 380


@pytest.mark.parametrize("seed", range(3))
def test_points_on_facets_out_of_reach_change_nothing(block: ReducedBody, seed: int) -> None:
    ball = Sphere(0.004, dim=block.dim)
    found = approaches(block, ball, 0.02, seed=seed)
    found = replace(found, max_depth=0.003)
    approach, limits = found.of(found.plan[0])
    everywhere = facet_lattice(block.mesh.points, block.mesh.facets, ball.size / 60.0)
    whole = replace(approach, surface=np.vstack([approach.surface, everywhere]))
    depths = limits.deepest * np.array([0.3, 1.0])
    assert len(approach.surface) < 0.5 * len(whole.surface)
    assert whole.thickness(0.003) == pytest.approx(limits.thickness)
    for pose, other in zip(approach.poses_at(depths), whole.poses_at(depths), strict=True):
        np.testing.assert_allclose(pose.translation, other.translation, atol=1e-9)


def test_what_limits_a_depth() -> None:
    assert DepthLimits(0.01, np.inf, np.inf).deepest == 0.01
    assert DepthLimits(0.01, 0.004, np.inf).deepest == 0.004
    assert DepthLimits(0.01, 0.004, 0.002).deepest == 0.002
    assert DepthLimits(0.01, 0.004, 0.0).deepest == pytest.approx(0.0004)
