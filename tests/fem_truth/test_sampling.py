"""Sampling of states, places, rotations, depths and approaches: invariances and properties of farthest
points."""

from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace

import numpy as np
import pytest

from softprint.fem_truth.sampling.contact_path import ContactPath, PathSample, node_speeds
from softprint.fem_truth.sampling.contact_places import (
    candidate_places,
    places_by_state,
    spread_places,
    surface_distances,
)
from softprint.fem_truth.sampling.contact_plan import ContactPlan
from softprint.fem_truth.sampling.depths import noisy_depths
from softprint.fem_truth.sampling.farthest import farthest_selection
from softprint.fem_truth.sampling.forced_states import forced_states
from softprint.fem_truth.sampling.recorded_states import spread_states
from softprint.fem_truth.sampling.rigid_free import RigidFreeDescriptor
from softprint.fem_truth.sampling.rotations import random_rotation, spread_rotations
from softprint.fem_truth.statics.newton import FullSpaceSettings
from softprint.runtime.arrays import Array
from softprint.runtime.body import assemble_body, frame_in_box, place_handles
from softprint.runtime.body.body import ReducedBody
from softprint.runtime.body.node_gradients import basis_gradient_at_nodes
from softprint.runtime.colliders import Box, Sphere
from softprint.runtime.colliders.approach import Approach, OutOfReach
from softprint.runtime.colliders.collider import Collider
from softprint.runtime.elasticity.materials import make_material
from softprint.runtime.errors import SoftprintError
from softprint.runtime.mesh import box_mesh


def small_body(dim: int, frame: bool) -> ReducedBody:
    mesh = box_mesh((-0.05,) * (dim - 1) + (0.0,), (0.05,) * dim, (6,) * dim)
    box = [[-1.0] * dim, [1.0] * (dim - 1) + [0.012]]
    frames = [frame_in_box(mesh, "base", box)] if frame else []
    handles = place_handles(mesh, 6, frames)
    return assemble_body(mesh, handles, make_material("linear", 1e4, 0.3), 1000.0, name="block")


@pytest.fixture(scope="module", params=[(2, True), (2, False), (3, True), (3, False)], ids=str)
def body(request: pytest.FixtureRequest) -> ReducedBody:
    return small_body(*request.param)


def random_states(body: ReducedBody, count: int, rng: np.random.Generator) -> np.ndarray:
    """Rest and rigid-framed random states near it."""
    n_dofs = body.n_dofs
    scale = np.full(n_dofs, 0.01)
    return np.array(
        [body.rest_rows]
        + [body.handles.retract(body.rest_rows, scale * rng.standard_normal(n_dofs)) for _ in range(count)]
    )


def moved(body: ReducedBody, rows: np.ndarray, rotation: np.ndarray, shift: np.ndarray) -> np.ndarray:
    """The state after a rigid motion of the whole body."""
    result = rows @ rotation.T
    result[: body.handles.n_points] += shift
    for frame in body.handles.frames:
        result[body.handles.rows_of(frame.name).stop - 1] += shift
    return result


def test_rigid_motion_leaves_descriptor_and_selection_unchanged(body: ReducedBody) -> None:
    rng = np.random.default_rng(0)
    states = random_states(body, 30, rng)
    turned = np.array(
        [moved(body, rows, random_rotation(body.dim, rng), rng.standard_normal(body.dim)) for rows in states]
    )
    descriptor = RigidFreeDescriptor.of(body)
    # 1e-10: round-off of metre-sized shifts against edges of centimetres, scaled up by the normalisation.
    np.testing.assert_allclose(descriptor.normalised(turned), descriptor.normalised(states), atol=1e-10)
    np.testing.assert_array_equal(spread_states(body, turned, 8), spread_states(body, states, 8))


def test_states_begin_with_the_one_nearest_to_rest(body: ReducedBody) -> None:
    states = random_states(body, 10, np.random.default_rng(1))[::-1]
    assert spread_states(body, states, 3)[0] == len(states) - 1


def test_every_edge_of_the_descriptor_has_unit_variance(body: ReducedBody) -> None:
    descriptor = RigidFreeDescriptor.of(body)
    numbers = descriptor.normalised(random_states(body, 40, np.random.default_rng(2)))
    # Each edge contributes variance 1 in all.
    assert np.isclose(np.mean(np.sum(numbers**2, axis=1)), len(descriptor.edges))


def test_farthest_selection_is_greedy_and_stops_at_duplicates() -> None:
    points = np.array([[0.0], [1.0], [0.4], [0.4], [1.0]])
    chosen = farthest_selection(lambda k: np.linalg.norm(points - points[k], axis=1), 0, 5)
    np.testing.assert_array_equal(chosen, [0, 1, 2])


def test_a_prefix_of_a_selection_is_the_selection_of_that_length() -> None:
    points = np.random.default_rng(0).random((200, 3))
    distance = lambda k: np.linalg.norm(points - points[k], axis=1)  # noqa: E731
    np.testing.assert_array_equal(farthest_selection(distance, 7, 20)[:9], farthest_selection(distance, 7, 9))


def test_surface_distance_along_a_square_is_its_arc_length() -> None:
    mesh = box_mesh((0.0, 0.0), (1.0, 1.0), (8, 8))
    corner = int(np.argmin(mesh.points.sum(axis=1)))
    distance = surface_distances(mesh, np.array([corner]))
    opposite = np.searchsorted(mesh.surface_nodes, int(np.argmax(mesh.points.sum(axis=1))))
    assert np.isclose(distance[opposite], 2.0)
    assert np.isclose(distance.max(), 2.0)


def test_places_keep_clear_of_frames_and_apart(body: ReducedBody) -> None:
    clearance = 0.015
    places = spread_places(body, 8, clearance)
    assert len(set(places.tolist())) == 8
    frame_nodes = body.handles.frame_nodes
    if len(frame_nodes):
        gap = np.linalg.norm(body.mesh.points[places][:, None] - body.mesh.points[frame_nodes], axis=2).min()
        assert gap > clearance
    index = {int(node): k for k, node in enumerate(body.mesh.surface_nodes)}
    apart = [surface_distances(body.mesh, places[:k])[index[int(places[k])]] for k in range(1, len(places))]
    assert np.all(np.diff(apart) <= 1e-12)  # greedy: each is as far as can be, so distances only fall


def test_places_lie_in_the_region_that_is_asked_for(body: ReducedBody) -> None:
    lower, upper = body.mesh.points.min(axis=0), body.mesh.points.max(axis=0)
    middle = 0.5 * (lower + upper)
    region = tuple(map(tuple, (np.append(lower[:-1], middle[-1]), upper)))
    places = spread_places(body, 4, 0.0, region)
    assert (body.mesh.points[places, -1] >= middle[-1]).all()
    half = int(candidate_places(body, 0.0, region).sum())
    assert 4 < half < int(candidate_places(body, 0.0).sum())
    with pytest.raises(SoftprintError, match=f"only {half} surface nodes .* and in sampling.region"):
        spread_places(body, half + 1, 0.0, region)


def test_states_share_no_place_while_there_are_enough(body: ReducedBody) -> None:
    places = places_by_state(body, 4, 3, 0.015)
    assert places.shape == (3, 4)
    assert len(np.unique(places)) == 12
    n_candidates = int(candidate_places(body, 0.015).sum())
    many = places_by_state(body, n_candidates, 3, 0.015)
    assert all(len(set(row)) == n_candidates for row in many.tolist())


def test_random_rotations_are_rotations_and_uniform() -> None:
    """The mean over SO(dim) is zero; of 2,000 draws with entries of variance 1/dim it is so to four sigma."""
    for dim in (2, 3):
        rng = np.random.default_rng(0)
        drawn = np.stack([random_rotation(dim, rng) for _ in range(2000)])
        np.testing.assert_allclose(
            drawn @ drawn.transpose(0, 2, 1), np.broadcast_to(np.eye(dim), drawn.shape), atol=1e-14
        )
        assert (np.linalg.det(drawn) > 0).all()
        assert np.abs(drawn.mean(axis=0)).max() < 4 / np.sqrt(dim * 2000)


def test_too_many_places_are_refused_with_the_number_that_there_are(body: ReducedBody) -> None:
    n_candidates = int(candidate_places(body, 0.015).sum())
    with pytest.raises(SoftprintError, match=f"only {n_candidates} surface nodes"):
        spread_places(body, n_candidates + 1, 0.015)


@pytest.mark.parametrize("dim", [2, 3])
def test_rotations_are_rotations_and_spread(dim: int) -> None:
    count = 12
    rotations = spread_rotations(dim, count, np.random.default_rng(5))
    np.testing.assert_allclose(
        rotations @ rotations.transpose(0, 2, 1), np.broadcast_to(np.eye(dim), rotations.shape), atol=1e-14
    )
    np.testing.assert_allclose(np.linalg.det(rotations), 1.0)
    trace = np.einsum("aij,bij->ab", rotations, rotations)
    angle = np.arccos(np.clip((trace - 1) / 2 if dim == 3 else trace / 2, -1, 1))
    closest = np.min(angle + 10 * np.eye(count))
    # 2D: evenly spaced. 3D: 12 even balls of SO(3) have a radius of about 60 degrees; greedy reaches well
    # over half.
    assert closest > (2 * np.pi / count - 1e-9 if dim == 2 else np.radians(60))


def test_depths_ascend_and_never_exceed_the_largest() -> None:
    depths = noisy_depths(5, 0.01, 0.4, np.random.default_rng(0))
    assert np.all(np.diff(depths) > 0)
    assert depths[0] > 0
    assert depths[-1] <= 0.01
    np.testing.assert_allclose(
        noisy_depths(4, 0.01, 0.0, np.random.default_rng(0)), [0.0025, 0.005, 0.0075, 0.01]
    )


@pytest.mark.parametrize("dim", [2, 3])
def test_the_requested_depth_is_reached_exactly(dim: int) -> None:
    body = small_body(dim, frame=True)
    mesh = body.mesh
    rng = np.random.default_rng(4)
    collider = Box(np.full(dim, 0.02), rounding=0.005)
    surface = mesh.points[mesh.surface_nodes] + 0.001 * rng.standard_normal((len(mesh.surface_nodes), dim))
    depths = np.array([0.001, 0.004, 0.01])
    for node in (0, 11, len(surface) - 1):
        approach = Approach(
            collider, surface, surface[node], mesh.surface_normals[node], random_rotation(dim, rng)
        )
        for depth, pose in zip(depths, approach.poses_at(depths), strict=True):
            deepest = -collider.sdf(pose.apply_inverse(surface)).min()
            assert abs(deepest - depth) < 1e-9  # the root finder's tolerance is 1e-12 sizes of the collider
            # This is the first such pose coming from outside: a little farther out the collider is not as deep.
            s = (pose.translation - approach.place) @ approach.normal
            assert all(approach.depth(s + out) < depth for out in np.linspace(1e-6, 0.2, 400))


def test_a_depth_beyond_the_collider_is_out_of_reach() -> None:
    mesh = small_body(2, frame=False).mesh
    surface = mesh.points[mesh.surface_nodes]
    approach = Approach(Sphere(0.01, dim=2), surface, surface[0], mesh.surface_normals[0], np.eye(2))
    with pytest.raises(OutOfReach, match=r"never gets 0\.02 m"):
        approach.poses_at(np.array([0.02]))


def test_the_depth_is_limited_by_the_thickness_of_the_collider() -> None:
    mesh = small_body(3, frame=False).mesh
    surface = mesh.points[mesh.surface_nodes]
    top = int(np.argmax(surface @ [0.1, 0.2, 1.0]))
    plate = Box([0.03, 0.03, 0.002], 0.0005)

    def sensible(collider: Collider, depth: float) -> float:
        return Approach(collider, surface, surface[top], mesh.surface_normals[top], np.eye(3)).sensible(depth)

    # Face first: to the middle of the plate, 2 mm below either face. The steps of the search are 0.3 mm.
    assert 0.0017 <= sensible(plate, 0.01) <= 0.002
    assert sensible(plate, 0.001) == 0.001
    assert sensible(Sphere(0.03), 0.01) == 0.01


def test_plan_is_a_permutation_with_balanced_prefixes() -> None:
    plan = ContactPlan(n_states=3, places=(8,), n_rotations=5, turns=5, repeat_share=0.1, seed=1)
    contacts = list(plan)
    assert len({(c.state, c.place, c.rotation) for c in contacts}) == len(plan) == 120
    first = contacts[: 3 * 8]
    assert {(c.state, c.place) for c in first} == {(s, p) for s in range(3) for p in range(8)}
    counts = np.bincount([c.rotation for c in first], minlength=5)
    assert counts.max() - counts.min() <= 3  # 24 contacts over 5 rotations, state by state
    assert sum(c.repeated for c in contacts) == 12


def test_colliders_share_the_plan_and_begin_at_different_places() -> None:
    plan = ContactPlan(n_states=2, places=(5, 5, 3), n_rotations=4, turns=1, repeat_share=0.0, seed=1)
    contacts = list(plan)
    assert len(contacts) == len(plan) == 2 * (5 + 5 + 3)
    met = {number: {c.place for c in contacts if (c.collider, c.state) == (number, 1)} for number in range(3)}
    assert [len(places) for places in met.values()] == [5, 5, 3]
    # Every prefix is useful: all colliders and states come before a second place of any.
    assert len({(c.collider, c.state) for c in contacts[:6]}) == 6
    assert len({c.place for c in contacts[:6:2]}) == 3
    # A plan with one collider has the same numbers as before.
    alone = ContactPlan(2, (5,), 4, 4, 0.0, seed=1)
    drawn = [p.rng(2, c).random() for p, c in ((plan, contacts[0]), (alone, alone[0]))]
    assert drawn[0] == drawn[1] != plan.rng(2, contacts[2]).random()


def test_random_numbers_of_a_contact_do_not_depend_on_earlier_draws() -> None:
    plan = ContactPlan(2, (3,), 4, 4, 0.0, seed=9)
    alone = plan.rng(2, plan[17]).random(3)
    for contact in plan:
        drawn = plan.rng(2, contact).random(3)
    assert not np.array_equal(alone, drawn)
    np.testing.assert_array_equal(plan.rng(2, plan[17]).random(3), alone)


def test_node_speeds_distinguish_a_jump_from_smooth_contact() -> None:
    down = np.array([[0.0, -1.0], [0.0, -0.5]])
    depths = np.array([0.001, 0.002, 0.003, 0.004])
    smooth = [depth * down for depth in depths]
    np.testing.assert_allclose(node_speeds(smooth, depths), 1.0)
    snapped = [*smooth[:2], smooth[2] + [0.004, 0.0], None]
    speeds = node_speeds(snapped, depths)
    assert speeds[2] > 4
    assert np.isnan(speeds[3])


def _path(displacement: Callable[[float], float], fails: tuple[float, float] = (1.0, 1.0)) -> list[PathSample]:
    """Of a body of one node that is where `displacement` (m) has it at a depth; no solve converges between the depths
    `fails` [m]."""

    def solve(depth: float, settings: FullSpaceSettings, x: Array) -> SimpleNamespace:
        found = {"newton_iterations": 1, "cg_iterations": 1, "seconds": 0.0}
        x = np.array([[0.0, -displacement(depth)]])
        return SimpleNamespace(x=x, converged=not fails[0] < depth < fails[1], **found)

    problem = SimpleNamespace(press=lambda *_: SimpleNamespace(solve=solve))
    approach = SimpleNamespace(poses_at=list)  # a pose is its depth
    path = ContactPath(problem, None, None, np.zeros((1, 2)), approach, FullSpaceSettings())
    return path.load(np.array([0.001, 0.002, 0.003]))


def test_a_jump_is_what_happens_in_a_part_of_a_step() -> None:
    """One node, three depths: pushed, three times as fast as the collider, or snapping 3 mm aside on the way."""
    for smooth in (lambda d: d, lambda d: 3.0 * d, lambda d: 1e3 * d**2):
        samples = _path(smooth)
        assert [sample.jumped for sample in samples] == [False] * 3
    assert samples[2].work.newton_iterations == 1 + 4  # five times as fast as the collider
    snapped = _path(lambda d: d + 0.003 * (d > 0.0024))
    assert [sample.jumped for sample in snapped] == [False, False, True]
    # What cannot be followed in parts is not known to be smooth.
    assert _path(lambda d: 3.0 * d, fails=(0.0021, 0.0024))[2].jumped


@pytest.mark.parametrize("seed", range(20))
def test_a_depth_that_the_march_meets_exactly_is_reached(seed):
    """Straight above a node the distance falls as the ball moves: the march lands on the depth, to round-off."""
    rng = np.random.default_rng(seed)
    surface = np.column_stack([np.linspace(-0.05, 0.05, 13), np.full(13, rng.uniform(0.01, 0.1))])
    ball = Sphere(rng.uniform(0.005, 0.03), dim=2)
    approach = Approach(ball, surface, surface[6], np.array([0.0, 1.0]), np.eye(2))
    depths = np.sort(rng.uniform(1e-4, 2e-3, 5))
    found = [approach.depth(pose.translation[1] - surface[6, 1]) for pose in approach.poses_at(depths)]
    np.testing.assert_allclose(found, depths, rtol=1e-9)


def test_forced_states_move_as_far_as_they_are_told(body):
    """The node that moves most, relative to the body; frames turn by finite angles, which is 1 % of the move here."""
    longest, rest = 1e-3, body.rest_rows
    rows = forced_states(body, 40, longest, False, np.random.default_rng(1))
    assert rows.shape == (40, *rest.shape)
    most = [np.linalg.norm(body.reduced_positions(own) - body.mesh.points, axis=1).max() for own in rows]
    assert max(most) < 1.01 * longest
    assert 0.1 * longest < 1.01 * min(most) < 0.4 * longest
    for own in rows:
        body.handles.check_rows(own)  # frames are rigid
    again = forced_states(body, 40, longest, False, np.random.default_rng(1))
    np.testing.assert_array_equal(again, rows)


@pytest.mark.parametrize("dim", [2, 3])
def test_forces_on_one_point_move_mostly_that_point(dim):
    """Beside a frame, in some states one point moves farther than any other by half."""
    body = small_body(dim, True)
    rows = forced_states(body, 60, 1e-4, False, np.random.default_rng(2))
    points = np.linalg.norm((rows - body.rest_rows)[:, : body.handles.n_points], axis=2)
    points.sort(axis=1)
    assert (points[:, -1] > 1.5 * points[:, -2]).mean() > 0.1


def test_forced_states_do_not_turn_the_subspace_inside_out(body):
    """However far they are told to move."""
    rows = forced_states(body, 30, body.mesh.size, False, np.random.default_rng(4))
    gradient = basis_gradient_at_nodes(body)
    assert min(np.linalg.det(own.T @ gradient).min() for own in rows) > 0.0
    most = [np.linalg.norm(body.reduced_positions(own) - body.mesh.points, axis=1).max() for own in rows]
    assert max(most) > 0.1 * body.mesh.size  # and still move


def test_forced_states_under_gravity_lie_every_way(body):
    """The strain is that of a body which is not turned; the mean of 200 rotations is nearly zero."""
    rng = np.random.default_rng(3)
    rows = forced_states(body, 200, 1e-4, True, rng)
    G = body.basis.T @ (body.mesh.points - body.mesh.points.mean(axis=0))  # of rows^T G, nearly a multiple of R
    turned = np.array([own.T @ G for own in rows])
    turned /= np.linalg.norm(turned, axis=(1, 2))[:, None, None] / np.sqrt(body.dim)
    assert np.abs(turned.mean(axis=0)).max() < 0.25
