"""Handles: the tangent space of the frames, placement, and what is refused."""

import numpy as np
import pytest
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from softprint.runtime.body.farthest_points import farthest_points
from softprint.runtime.body.handles import Handles
from softprint.runtime.body.placement import frame_along, frame_in_box, place_handles
from softprint.runtime.body.rotations import nearest_rotation, rotation_exponential
from softprint.runtime.errors import SoftprintError
from softprint.runtime.mesh import box_mesh

STEP = 1e-5  # central differences then err by about 1e-10


def box_with_handles(dim):
    """A box with five points and two frames, off the origin so that pivots matter."""
    mesh = box_mesh([1.0] * dim, [2.0] * dim, [6] * dim)
    left = frame_in_box(mesh, "left", [[0.9] * dim, [1.2] + [3.0] * (dim - 1)])
    right = frame_in_box(mesh, "right", [[1.8] + [0.9] * (dim - 1), [3.0] * dim])
    return mesh, place_handles(mesh, 5, [left, right])


def moved_rows(mesh, handles, rng):
    return handles.retract(handles.rest_rows(mesh.points), 0.3 * rng.normal(size=handles.n_dofs))


@pytest.mark.parametrize("dim", [2, 3])
def test_counts_and_addresses(dim):
    mesh, handles = box_with_handles(dim)
    assert handles.n_rows == 5 + 2 * (dim + 1)
    assert handles.n_dofs == 5 * dim + 2 * (3 if dim == 2 else 6)
    assert handles.rows_of(2) == slice(2, 3)
    assert handles.rows_of("right") == slice(5 + dim + 1, 5 + 2 * (dim + 1))
    assert handles.dofs_of("right").stop == handles.n_dofs
    rest = handles.rest_rows(mesh.points)
    np.testing.assert_array_equal(handles.position(rest, 3), mesh.points[handles.points[3]])
    np.testing.assert_allclose(
        handles.position(rest, "left"), mesh.points[handles.frames[0].nodes].mean(axis=0)
    )
    for wrong, words in ((5, "no point handle 5"), ("middle", "no frame named 'middle'.*left, right")):
        with pytest.raises(SoftprintError, match=words):
            handles.rows_of(wrong)


@pytest.mark.parametrize("dim", [2, 3])
def test_exponential_map_matches_scipy(dim):
    rng = np.random.default_rng(1)
    for scale in (0.0, 1e-9, 0.5, 3.0):
        vector = scale * rng.normal(size=dim * (dim - 1) // 2)
        in_space = vector if dim == 3 else np.array([0.0, 0.0, vector[0]])
        expected = Rotation.from_rotvec(in_space).as_matrix()[:dim, :dim]
        np.testing.assert_allclose(rotation_exponential(vector), expected, atol=1e-14)


@pytest.mark.parametrize("dim", [2, 3])
def test_retraction_keeps_frames_rigid_and_moves_the_pivot_by_its_translation(dim):
    rng = np.random.default_rng(2)
    mesh, handles = box_with_handles(dim)
    rows = moved_rows(mesh, handles, rng)
    handles.check_rows(rows)
    increment = rng.normal(size=handles.n_dofs)
    after = handles.retract(rows, increment)
    handles.check_rows(after)
    shift = increment[handles.dofs_of("right")][:dim]
    np.testing.assert_allclose(
        handles.position(after, "right") - handles.position(rows, "right"), shift, atol=1e-13
    )
    assert np.array_equal(handles.retract(rows, np.zeros(handles.n_dofs)), rows) or np.allclose(
        handles.retract(rows, np.zeros(handles.n_dofs)), rows, atol=1e-15
    )


@pytest.mark.parametrize("dim", [2, 3])
def test_tangent_is_the_derivative_of_the_retraction(dim):
    rng = np.random.default_rng(3)
    mesh, handles = box_with_handles(dim)
    rows = moved_rows(mesh, handles, rng)
    differences = [
        (handles.retract(rows, STEP * axis) - handles.retract(rows, -STEP * axis)).ravel() / (2 * STEP)
        for axis in np.eye(handles.n_dofs)
    ]
    np.testing.assert_allclose(handles.tangent(rows), np.column_stack(differences), atol=1e-9)
    gradient = rng.normal(size=rows.shape)
    # Round-off.
    np.testing.assert_allclose(
        handles.pulled_back(rows, gradient), gradient.ravel() @ handles.tangent(rows), atol=1e-13
    )


@pytest.mark.parametrize("dim", [2, 3])
def test_linearised_frames_are_turned_by_their_sines(dim):
    """A projection, which keeps infinitesimal motions as they are. Of a frame that has turned by a finite angle about
    an axis through its pivot it keeps the sine about that axis; points keep their displacements."""
    mesh, handles = box_with_handles(dim)
    rest, P = handles.rest_rows(mesh.points), handles.linearised_frames
    np.testing.assert_allclose(P @ P, P, atol=1e-15)
    tangent = handles.tangent(rest)
    np.testing.assert_allclose(P @ tangent, tangent, atol=1e-15)
    angle, spins = 0.7, handles.n_dofs - handles.dofs_of("right").start - dim
    motion = np.zeros(handles.n_dofs)
    motion[handles.dofs_of("right")][dim:] = angle * np.eye(spins)[-1]
    motion[handles.dofs_of("right")][:dim] = 0.1
    motion[handles.dofs_of(1)] = 0.2
    sines = motion.copy()
    sines[handles.dofs_of("right")][dim:] *= np.sin(angle) / angle
    moved = (handles.retract(rest, motion) - rest).ravel()
    np.testing.assert_allclose(P @ moved, tangent @ sines, atol=1e-14)
    assert np.abs(moved - tangent @ sines).max() > 0.1


@pytest.mark.parametrize("dim", [2, 3])
def test_increment_is_the_best_rigid_explanation_of_a_change(dim):
    rng = np.random.default_rng(5)
    mesh, handles = box_with_handles(dim)
    rows = moved_rows(mesh, handles, rng)
    tangent = handles.tangent(rows)
    v = rng.normal(size=handles.n_dofs)
    found = handles.increment(rows, (tangent @ v).reshape(rows.shape))
    np.testing.assert_allclose(found, v, atol=1e-12)  # round-off of a few small solves
    change = rng.normal(size=rows.shape)  # no rigid one
    best = np.linalg.lstsq(tangent, change.ravel(), rcond=None)[0]
    np.testing.assert_allclose(handles.increment(rows, change), best, atol=1e-12)


@pytest.mark.parametrize("dim", [2, 3])
def test_curvature_makes_newtons_hessian_exact(dim):
    """d2/dv2 of a quartic of the rows along the retraction, by differences of differences."""
    rng = np.random.default_rng(4)
    mesh, handles = box_with_handles(dim)
    rows = moved_rows(mesh, handles, rng)
    mix = rng.normal(size=(rows.size, rows.size)) / rows.size

    def energy(v):
        moved = mix @ handles.retract(rows, v).ravel()
        return 0.25 * (moved**4).sum()

    inner = mix @ rows.ravel()
    gradient = (mix.T @ inner**3).reshape(rows.shape)
    tangent = handles.tangent(rows)
    exact = tangent.T @ (mix.T @ (3 * inner[:, None] ** 2 * mix)) @ tangent + handles.curvature(
        rows, gradient
    )
    step = 1e-4  # second differences: truncation 1e-8, cancellation 1e-16 / 1e-8 = 1e-8
    axes = step * np.eye(handles.n_dofs)
    turns = np.r_[handles.dofs_of("left"), handles.dofs_of("right")]
    for a in turns:
        for b in turns:
            corners = [energy(s * axes[a] + t * axes[b]) * s * t for s in (1, -1) for t in (1, -1)]
            assert sum(corners) / (4 * step**2) == pytest.approx(
                exact[a, b], abs=1e-6 * np.abs(exact).max() + 1e-7
            )


@pytest.mark.parametrize("dim", [2, 3])
def test_affine_rows_are_made_rigid_and_frames_set(dim):
    rng = np.random.default_rng(5)
    mesh, handles = box_with_handles(dim)
    rows = moved_rows(mesh, handles, rng)
    affine = rows + 0.05 * rng.normal(size=rows.shape)
    with pytest.raises(SoftprintError, match="not a rotation"):
        handles.check_rows(affine)
    rigid = handles.rigid(affine)
    handles.check_rows(rigid)
    np.testing.assert_allclose(handles.rigid(rows), rows, atol=1e-13)
    np.testing.assert_allclose(handles.position(rigid, "left"), handles.position(affine, "left"), atol=1e-13)
    turn = rotation_exponential(rng.normal(size=dim * (dim - 1) // 2))
    placed = handles.with_frame(rows, "left", turn, np.arange(dim))
    pivot = handles.frames[0].pivot
    np.testing.assert_allclose(handles.position(placed, "left"), turn @ pivot + np.arange(dim), atol=1e-13)


def test_rows_of_wrong_shape_or_not_finite_are_refused():
    mesh, handles = box_with_handles(2)
    rows = handles.rest_rows(mesh.points)
    with pytest.raises(SoftprintError, match="shape"):
        handles.check_rows(rows[1:])
    rows[0, 0] = np.nan
    with pytest.raises(SoftprintError, match="not finite"):
        handles.check_rows(rows)


def test_nearest_rotation_is_proper():
    assert np.linalg.det(nearest_rotation(np.diag([1.0, 1.0, -0.9]))) == pytest.approx(1.0)


@pytest.mark.parametrize("dim", [2, 3])
def test_automatic_points_are_spread_over_the_free_surface(dim):
    mesh, handles = box_with_handles(dim)
    assert len(set(handles.points.tolist())) == 5
    assert np.isin(handles.points, mesh.surface_nodes).all()
    assert not np.isin(handles.points, handles.frame_nodes).any()
    again = box_with_handles(dim)[1]
    np.testing.assert_array_equal(handles.points, again.points)


def test_points_by_hand_snap_to_the_nearest_node():
    mesh = box_mesh([0, 0], [1, 1], [4, 4])
    handles = place_handles(mesh, [[0.02, 0.01], [0.98, 0], [0, 1]])
    np.testing.assert_allclose(mesh.points[handles.points], [[0, 0], [1, 0], [0, 1]])


def test_farthest_points_of_a_line():
    line = np.linspace(0, 1, 101)[:, None]
    np.testing.assert_array_equal(farthest_points(line, 4, first=0), [0, 100, 50, 25])
    assert sorted(farthest_points(np.zeros((3, 2)), 5)) == [0, 1, 2]  # coincident points are not chosen twice


@pytest.mark.parametrize(
    ("points", "frames", "words"),
    [
        ([[0, 0], [0.5, 0], [1, 0]], [], "do not span 2 dimensions"),
        ([[0, 0], [1, 0]], [], "at least 3 points"),
        ([[50.0, 0], [1, 0], [0, 1]], [], "are its units metres"),
        ([[0, 0], [0.01, 0], [0, 1]], [], "coincides with another point"),
        ([[0, 0, 0]], [], "3 coordinates each"),
        ([[0.1, 0.1]], [("a", [[-1, -1], [0.3, 2]])], "lies in a frame"),
        (200, [("a", [[-1, -1], [0.3, 2]])], "only .* surface nodes"),
        (1, [("a", [[-1, -1], [0.1, 2]])], "frame 'a'.*two layers"),
        (1, [("a", [[-1, -1], [2, 2]])], "contains every node"),
        (1, [("a", [[2, 2], [-1, -1]])], "no lower number above"),
        (1, [("a", [[2, 2, 2], [3, 3, 3]])], "of 2 numbers each"),
        (1, [("a", [[-1, -1], [0.3, 2]]), ("a", [[0.7, -1], [2, 2]])], "two frames are named 'a'"),
        (1, [("a", [[-1, -1], [0.6, 2]]), ("b", [[0.5, -1], [2, 2]])], "shares nodes"),
    ],
)
def test_bad_handles_are_refused_with_a_reason(points, frames, words):
    mesh = box_mesh([0, 0], [1, 1], [4, 4])
    with pytest.raises(SoftprintError, match=words):
        place_handles(mesh, points, [frame_in_box(mesh, name, box) for name, box in frames])


def test_a_bone_has_the_nodes_near_its_segments(dim):
    mesh = box_mesh([0.0] * dim, [1.0] * dim, [8] * dim)
    low, bend = np.full(dim, 0.25), np.append(0.75, np.full(dim - 1, 0.25))
    bone = frame_along(mesh, "bone", [[low, bend], [bend, np.full(dim, 0.75)]], 0.2)
    # A capsule is the union of balls about the points of its segment: so many that its border is accurate to 1e-3 of a
    # cell, and no node is that near to the border.
    along = np.linspace(0.0, 1.0, 2001)[:, None]
    line = np.vstack([low + along * (bend - low), bend + along * (np.full(dim, 0.75) - bend)])
    distance = cKDTree(line).query(mesh.points)[0]
    assert np.abs(distance - 0.2).min() > 1e-4
    np.testing.assert_array_equal(bone.nodes, np.flatnonzero(distance < 0.2))
    np.testing.assert_allclose(bone.pivot, mesh.points[bone.nodes].mean(axis=0))


@pytest.mark.parametrize(
    ("segments", "words"),
    [
        ([[[0.5, 0.5], [0.6, 0.5]]], "'bone', within 0.05 m of its segments: its 1 nodes do not span"),
        ([[[0.5, 0.5, 0.5], [0.6, 0.5, 0.5]]], "of 2 numbers each"),
        ([[0.5, 0.5], [0.6, 0.5]], "list of .start, end."),
    ],
)
def test_bad_bones_are_refused_with_a_reason(segments, words):
    with pytest.raises(SoftprintError, match=words):
        frame_along(box_mesh([0, 0], [1, 1], [4, 4]), "bone", segments, 0.05)


def test_handles_without_frames_have_no_curvature():
    handles = Handles(2, np.arange(3), ())
    rows = np.eye(3, 2)
    assert not handles.curvature(rows, rows).any()
    np.testing.assert_array_equal(handles.tangent(rows), np.eye(6))


@pytest.mark.parametrize("dim", [2, 3])
def test_without_frames_points_take_the_whole_change(dim):
    mesh = box_mesh([0.0] * dim, [1.0] * dim, [3] * dim)
    handles = place_handles(mesh, 5, [])
    rows = handles.rest_rows(mesh.points)
    change = np.random.default_rng(4).normal(size=rows.shape)
    np.testing.assert_array_equal(handles.increment(rows, change), change.ravel())
    np.testing.assert_array_equal(handles.tangent(rows), np.eye(rows.size))
    assert not handles.curvature(rows, change).any()
