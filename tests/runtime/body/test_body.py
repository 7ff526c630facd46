"""Reduced bodies: basis, projection, mass, cubature, material points, surface samples."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.linalg import eigh

from softprint.runtime.body import assemble_body, build_body, frame_in_box, place_handles
from softprint.runtime.body.basis import biharmonic_basis
from softprint.runtime.body.cubature import (
    choose_cubature,
    cubature_error,
    interpolation_weights,
    random_states,
)
from softprint.runtime.body.handles import Handles
from softprint.runtime.body.surface_samples import sample_surface
from softprint.runtime.colliders import RigidPose
from softprint.runtime.elasticity import make_material
from softprint.runtime.errors import SoftprintError
from softprint.runtime.mechanics.compliance.null_space_compliance import NullSpaceCompliance, rest_stiffness
from softprint.runtime.mesh import box_mesh, write_mesh

AFFINE = 1e-10  # libigl's sparse solve reproduces affine maps to about 1e-13 on small meshes


def make_box(dim, divisions=8):
    counts = [divisions, divisions // 2, divisions // 2][:dim]
    return box_mesh([0.0] * dim, [0.1, 0.05, 0.05][:dim], counts)


def make_body(dim, **options):
    mesh = make_box(dim)
    frame = frame_in_box(mesh, "base", [[-1.0] * dim, [0.015] + [1.0] * (dim - 1)])
    handles = place_handles(mesh, 6, [frame])
    return assemble_body(
        mesh, handles, make_material("stable_neo_hookean", 2e4, 0.4), 1000.0, name="box", **options
    )


@pytest.fixture(scope="module", params=[2, 3])
def body(request):
    return make_body(request.param)


def test_basis_interpolates_handles_and_reproduces_affine_maps(body):
    rng = np.random.default_rng(0)
    dim, points = body.dim, body.mesh.points
    map_, shift = rng.normal(size=(dim, dim)), rng.normal(size=dim)
    rows = np.vstack([points[body.handles.points] @ map_.T + shift, map_.T, shift])
    np.testing.assert_allclose(body.reduced_positions(rows), points @ map_.T + shift, atol=AFFINE)
    loose = rng.normal(size=rows.shape)
    moved = body.reduced_positions(loose)
    np.testing.assert_allclose(moved[body.handles.points], loose[: body.handles.n_points], atol=AFFINE)
    region = body.handles.frames[0].nodes
    np.testing.assert_allclose(moved[region], points[region] @ loose[-dim - 1 : -1] + loose[-1], atol=AFFINE)


def test_projection_recovers_the_state(body):
    rows = body.rest_rows + 0.005 * np.random.default_rng(1).normal(size=body.rest_rows.shape)
    rows = body.handles.rigid(rows)
    np.testing.assert_allclose(body.project(body.reduced_positions(rows)), rows, atol=AFFINE)


def test_the_residual_of_projection_is_orthogonal_to_the_point_columns(body):
    """Frames are fitted to their nodes; elsewhere the residual is orthogonal to the columns of the points."""
    x = body.mesh.points + 0.003 * np.sin(40 * body.mesh.points[:, ::-1])
    region = body.handles.frame_nodes
    turn = RigidPose.from_rotation_vector(
        [0.3] if body.dim == 2 else [0.3, 0.1, -0.2], np.full(body.dim, 0.02)
    )
    x[region] = turn.apply(body.mesh.points[region])
    rows = body.project(x)
    body.handles.check_rows(rows)
    reduced = body.reduced_positions(rows)
    np.testing.assert_allclose(reduced[region], x[region], atol=AFFINE)
    free = np.setdiff1d(np.arange(body.n_nodes), region)
    assert np.abs(body.constraint_basis[free].T @ (x - reduced)[free]).max() < 100 * AFFINE  # sums over nodes


def test_mass_is_that_of_the_box_and_translations_have_all_of_it(body):
    mass = 1000.0 * body.mesh.cell_volumes.sum()
    assert body.node_mass.sum() == pytest.approx(mass, rel=1e-12)
    carry = np.zeros(body.n_rows)  # rows that move every node by one: the points and the frame's translation
    carry[: body.handles.n_points] = carry[-1] = 1.0
    assert carry @ body.reduced_mass @ carry == pytest.approx(mass, rel=1e-9)


def test_cubature_integrates_the_volume_and_its_stated_error_is_true(body):
    cubature = body.cubature
    assert (cubature.weights > 0).all()
    assert (np.diff(cubature.cells) > 0).all()
    assert len(cubature.cells) <= 10 * body.n_rows
    region = np.isin(body.mesh.cells, body.handles.frames[0].nodes).all(axis=1)
    assert not region[cubature.cells].any()  # rigid cells store no energy
    # Not imposed, but close: the basis holds affine maps, whose moments are the volume.
    assert cubature.weights.sum() == pytest.approx(body.mesh.cell_volumes[~region].sum(), rel=0.05)
    states = random_states(body.mesh, body.handles, np.random.default_rng(0))
    args = (body.mesh, body.basis, body.handles, body.material, cubature.cells, cubature.weights, states)
    assert cubature_error(*args) == pytest.approx((cubature.energy_error, cubature.force_error), rel=1e-12)


def test_full_cubature_has_no_error(body):
    full = assemble_body(body.mesh, body.handles, body.material, body.density, points_per_row=10**6)
    assert full.cubature.energy_error < 1e-12
    assert full.cubature.force_error < 1e-12


def test_more_cubature_cells_err_less_and_less_than_the_thesis_weights():
    mesh = make_box(3, divisions=12)
    handles = place_handles(mesh, 6, [frame_in_box(mesh, "base", [[-1.0] * 3, [0.012, 1.0, 1.0]])])
    material, basis = make_material("stable_neo_hookean", 2e4, 0.4), biharmonic_basis(mesh, handles)
    states = random_states(mesh, handles, np.random.default_rng(1))

    def force_error(per_row, weights=None):
        cells, ours = choose_cubature(mesh, basis, handles, material, per_row * handles.n_rows)
        chosen = ours if weights is None else weights(mesh, cells)
        return cubature_error(mesh, basis, handles, material, cells, chosen, states)[1]

    assert force_error(20) < 0.7 * force_error(5)
    assert force_error(10) < 0.7 * force_error(10, interpolation_weights)


def test_each_material_region_has_its_own_cubature_cells():
    mesh = make_box(2)
    handles = place_handles(mesh, 4, [])
    stiff = np.zeros(mesh.n_cells, dtype=bool)
    stiff[7] = True  # a region of a single cell
    material = make_material("linear", np.where(stiff, 2e6, 2e4), np.full(mesh.n_cells, 0.3))
    cells, _ = choose_cubature(mesh, biharmonic_basis(mesh, handles), handles, material, 12)
    assert stiff[cells].any()
    assert (~stiff[cells]).sum() >= 8


def test_material_points_know_gradient_distance_and_normal(body):
    points = body.node_points()
    dim = body.dim
    # The nodal gradient of the rest state is the identity.
    np.testing.assert_allclose(
        np.einsum("ri,nrj->nij", body.rest_rows, points.basis_gradient),
        np.tile(np.eye(dim), (len(points), 1, 1)),
        atol=1e-9,
    )
    lower, upper = points.rest.min(axis=0), points.rest.max(axis=0)
    to_faces = np.minimum(points.rest - lower, upper - points.rest).min(axis=1)
    np.testing.assert_allclose(points.surface_distance, to_faces, atol=1e-12)
    np.testing.assert_allclose(np.linalg.norm(points.surface_normal, axis=1), 1.0, rtol=1e-9)
    inside = np.flatnonzero(points.surface_distance > 0)
    at_face = points.rest[inside] + points.surface_distance[inside, None] * points.surface_normal[inside]
    assert np.abs(np.minimum(at_face - lower, upper - at_face).min(axis=1)).max() < 1e-12
    some = body.node_points(np.array([3, 1]))
    np.testing.assert_array_equal(some.rest, body.mesh.points[[3, 1]])


def test_surface_samples_share_the_whole_area(body):
    few = sample_surface(body.mesh, 10)
    assert len(few.nodes) == 10
    assert np.isin(few.nodes, body.mesh.surface_nodes).all()
    assert few.areas.sum() == pytest.approx(body.mesh.surface_areas.sum(), rel=1e-12)
    assert (few.areas > 0).all()
    np.testing.assert_array_equal(sample_surface(body.mesh, 10**6).nodes, body.mesh.surface_nodes)


def test_hash_follows_what_defines_the_body_only():
    body = make_body(2)
    assert make_body(2).content_hash == body.content_hash
    assert make_body(2, points_per_row=4, surface_samples=20).content_hash == body.content_hash
    stiffer = make_material("stable_neo_hookean", 3e4, 0.4)
    assert assemble_body(body.mesh, body.handles, stiffer, 1000.0).content_hash != body.content_hash


def spec(**material):
    """The fields of a [body] table."""
    given = {"model": "linear", "young": 1e4, "poisson": 0.3, "density": 1000.0, "regions": []}
    return SimpleNamespace(
        mesh="box.vtu",
        handles=SimpleNamespace(
            points=3,
            frames=[SimpleNamespace(name="base", box=[[-1, -1], [0.03, 1]])],
            subspace="biharmonic_coordinates",
            hold="projection",
        ),
        material=SimpleNamespace(**{**given, **material}),
        cubature=SimpleNamespace(points_per_row=10),
        surface=SimpleNamespace(samples=12),
    )


def test_body_is_built_from_its_table(tmp_path):
    write_mesh(tmp_path / "box.vtu", make_box(2))
    region = SimpleNamespace(box=[[0.05, -1], [1, 1]], young=5e4, poisson=None, density=2000.0)
    body = build_body(spec(regions=[region]), tmp_path)
    stiff = body.mesh.cell_centroids[:, 0] > 0.05
    np.testing.assert_array_equal(body.material.young, np.where(stiff, 5e4, 1e4))
    assert (body.material.poisson == 0.3).all()
    np.testing.assert_array_equal(body.density, np.where(stiff, 2000.0, 1000.0))
    assert body.name == "box"
    assert len(body.surface.nodes) == 12
    nowhere = SimpleNamespace(box=[[5, 5], [6, 6]], young=1.0, poisson=None, density=None)
    with pytest.raises(SoftprintError, match=r"regions\[0\]: no cell"):
        build_body(spec(regions=[nowhere]), tmp_path)
    with pytest.raises(SoftprintError, match="density must be positive"):
        build_body(spec(density=-1.0), tmp_path)


def test_what_is_no_body_is_refused():
    """Before it can be saved to a file that cannot be read."""
    for wrong, words in (
        ({"hold": "zz"}, "hold must be one of projection, mass, nodes, not 'zz'"),
        ({"subspace": "zz"}, "subspace must be one of"),
        ({"surface_samples": 0}, "surface_samples must be at least 1, not 0"),
        ({"points_per_row": 0}, "points_per_row must be at least 1, not 0"),
    ):
        with pytest.raises(SoftprintError, match=words):
            make_body(2, **wrong)


@pytest.mark.parametrize("dim", [2, 3])
def test_a_state_is_held_by_fixing_nodes(dim):
    """Chapter 4 of the thesis: whatever the rest does, points are where the state has them; and the projection of a
    displaced body is that state."""
    body = make_body(dim, hold="nodes")
    rows = body.rest_rows + 0.003 * np.random.default_rng(2).normal(size=body.rest_rows.shape)
    rows = body.handles.rigid(rows)
    moved = body.reduced_positions(rows)
    others = np.setdiff1d(np.arange(body.n_nodes), np.append(body.handles.points, body.handles.frame_nodes))
    moved[others] += 0.002 * np.random.default_rng(3).normal(size=(len(others), dim))
    np.testing.assert_allclose(body.project(moved), rows, atol=AFFINE)
    by_projection = make_body(dim, hold="projection")
    assert np.abs(by_projection.project(moved) - rows).max() > 1e-5
    assert by_projection.content_hash != body.content_hash
    # Forces elsewhere leave the points where they are.
    forces = np.random.default_rng(4).normal(size=(*moved.shape, 1))
    response = NullSpaceCompliance(body).solve(forces)[..., 0]
    size = np.abs(response).max()
    assert np.abs(response[body.handles.points]).max() < 1e-9 * size  # round-off of the factorisation
    assert (
        np.abs(body.reduced_positions(body.project(body.mesh.points + response)) - body.mesh.points).max()
        < 1e-9
    )


@pytest.mark.parametrize("dim", [2, 3])
def test_what_settles_has_no_momentum_along_handles_held_by_mass(dim):
    body = make_body(dim, hold="mass")
    forces = np.random.default_rng(4).normal(size=(body.n_nodes, dim, 1))
    u = NullSpaceCompliance(body).solve(forces)[..., 0]
    points = body.basis[:, : body.handles.n_points]
    momentum = points.T @ (body.node_mass[:, None] * u)
    # Round-off of the factorisation.
    assert np.abs(momentum).max() < 1e-9 * body.node_mass.sum() * np.abs(u).max()
    rows = body.handles.rigid(
        body.rest_rows + 0.003 * np.random.default_rng(2).normal(size=body.rest_rows.shape)
    )
    np.testing.assert_allclose(body.project(body.reduced_positions(rows) + u), rows, atol=AFFINE)
    by_projection = make_body(dim, hold="projection")
    assert np.abs(by_projection.project(body.reduced_positions(rows) + u) - rows).max() > 1e-5
    assert by_projection.content_hash != body.content_hash


@pytest.mark.parametrize("dim", [2, 3])
def test_a_body_in_free_fall_held_by_mass_does_not_settle(dim):
    """Weight moves all of it alike; by the projection it would sag towards where nodes are not dense."""
    mesh = make_box(dim)
    settled = {}
    for hold in ("mass", "projection"):
        body = assemble_body(
            mesh,
            place_handles(mesh, 6, []),
            make_material("stable_neo_hookean", 2e4, 0.4),
            1000.0,
            name="box",
            hold=hold,
        )
        weight = np.zeros((body.n_nodes, dim, 1))
        weight[:, -1, 0] = -9.81 * body.node_mass
        settled[hold] = np.abs(NullSpaceCompliance(body).solve(weight)).max()
    assert settled["mass"] < 1e-6 * settled["projection"]


@pytest.mark.parametrize("dim", [2, 3])
def test_frequencies_of_a_body_held_by_mass_are_those_of_the_body(dim):
    """Of the condensed body with the mass of the subspace alone, U^T M U, beside all of the mesh."""
    off = {}
    for hold in ("mass", "projection"):
        body = make_body(dim, hold=hold)
        n, points = body.n_nodes, np.kron(body.basis[:, : body.handles.n_points], np.eye(dim))
        stiffness, mass = rest_stiffness(body), np.repeat(body.node_mass, dim)
        forces = -(stiffness @ points).reshape(n, dim, -1)
        moved = points + NullSpaceCompliance(body).solve(forces).reshape(n * dim, -1)
        condensed = eigh(
            moved.T @ (stiffness @ moved), points.T @ (mass[:, None] * points), eigvals_only=True
        )
        free = np.setdiff1d(np.arange(n), body.handles.frame_nodes)
        free = (free[:, None] * dim + np.arange(dim)).ravel()
        whole = eigh(stiffness[free][:, free].toarray(), np.diag(mass[free]), eigvals_only=True)
        off[hold] = np.abs(np.sqrt(condensed[:3] / whole[:3]) - 1.0).max()
    # What six points resolve of the three slowest vibrations.
    assert off["mass"] < 0.02
    assert off["mass"] < 0.6 * off["projection"]


def test_handles_without_nodes_are_refused():
    mesh = make_box(2)
    with pytest.raises(SoftprintError, match="biharmonic coordinates"):
        biharmonic_basis(
            mesh, Handles(2, np.array([0, 40]), ())
        )  # place_handles would not have let them through
    with pytest.raises(SoftprintError, match="share a node"):
        biharmonic_basis(mesh, Handles(2, np.array([0, 4, 40, 40]), ()))
