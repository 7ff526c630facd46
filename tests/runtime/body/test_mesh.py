"""Meshes: derived quantities compared with closed forms, repairs, and refusals."""

import logging

import meshio
import numpy as np
import pytest

from softprint.runtime.errors import SoftprintError
from softprint.runtime.mesh import box_mesh, in_morton_order, oriented_mesh, read_mesh, write_mesh

ROUND_OFF = 1e-12  # sums of a few hundred float64 terms of size one


def small_box(dim):
    return box_mesh([0.0] * dim, [1.0, 2.0, 3.0][:dim], [3, 2, 2][:dim])


@pytest.mark.parametrize("dim", [2, 3])
def test_box_has_the_volume_and_the_surface_of_a_box(dim):
    mesh = small_box(dim)
    assert (mesh.cell_volumes > 0).all()
    assert mesh.cell_volumes.sum() == pytest.approx({2: 2.0, 3: 6.0}[dim], rel=ROUND_OFF)
    assert mesh.surface_areas.sum() == pytest.approx({2: 6.0, 3: 22.0}[dim], rel=ROUND_OFF)
    assert mesh.node_volumes.sum() == pytest.approx(mesh.cell_volumes.sum(), rel=ROUND_OFF)


def test_spacing_of_surface_nodes(dim):
    """On a finely divided cube it tends to the length of the edges of its cells."""
    assert box_mesh([0.0] * dim, [1.0] * dim, [10] * dim).surface_spacing == pytest.approx(0.1, rel=1e-2)


@pytest.mark.parametrize("dim", [2, 3])
def test_surface_is_closed_and_points_outward(dim):
    mesh = small_box(dim)
    assert np.abs(mesh.facet_vectors.sum(axis=0)).max() < ROUND_OFF
    middles = mesh.points[mesh.facets].mean(axis=1)
    # Divergence theorem: the flux of x through the surface is dim times the volume.
    flux = (middles * mesh.facet_vectors).sum()
    assert flux == pytest.approx(dim * mesh.cell_volumes.sum(), rel=ROUND_OFF)
    outward = mesh.surface_normals * (mesh.points[mesh.surface_nodes] - mesh.points.mean(axis=0))
    assert (outward.sum(axis=1) > 0).all()


@pytest.mark.parametrize("dim", [2, 3])
def test_gradients_are_exact_for_affine_maps(dim):
    rng = np.random.default_rng(0)
    mesh = small_box(dim)
    map_, shift = rng.normal(size=(dim, dim)), rng.normal(size=dim)
    moved = mesh.points @ map_.T + shift
    np.testing.assert_allclose(
        mesh.deformation_gradients(moved), np.tile(map_, (mesh.n_cells, 1, 1)), atol=ROUND_OFF
    )
    for axis, derivative in enumerate(mesh.nodal_gradient):
        np.testing.assert_allclose(
            derivative @ moved, np.tile(map_[:, axis], (mesh.n_nodes, 1)), atol=ROUND_OFF
        )


@pytest.mark.parametrize("dim", [2, 3])
def test_surface_edges_obey_eulers_formula(dim):
    mesh = small_box(dim)
    vertices, edges, facets = len(mesh.surface_nodes), len(mesh.surface_edges), len(mesh.facets)
    assert vertices - edges + (facets if dim == 3 else 0) == (2 if dim == 3 else 0)


@pytest.mark.parametrize("dim", [2, 3])
def test_inverted_cells_are_flipped_and_unused_nodes_dropped(dim, caplog):
    mesh = small_box(dim)
    cells = mesh.cells.copy()
    cells[::3, :2] = cells[::3, 1::-1]
    with caplog.at_level(logging.INFO):
        repaired = oriented_mesh(np.vstack([mesh.points, np.full((2, dim), np.nan)]), cells)
    assert repaired.n_nodes == mesh.n_nodes
    np.testing.assert_allclose(repaired.cell_volumes, mesh.cell_volumes, rtol=ROUND_OFF)
    assert f"reoriented {len(cells[::3])} inverted" in caplog.text
    assert "dropped 2 nodes" in caplog.text


@pytest.mark.parametrize("dim", [2, 3])
def test_morton_order_only_renumbers(dim):
    mesh, ordered = small_box(dim), in_morton_order(small_box(dim))
    assert ordered.cell_volumes.sum() == pytest.approx(mesh.cell_volumes.sum(), rel=ROUND_OFF)
    assert {tuple(p) for p in ordered.points} == {tuple(p) for p in mesh.points}


def two_tets_sharing_an_edge():
    points = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [0, -1, 0], [0, 0, -1.0]])
    return points, np.array([[0, 1, 2, 3], [0, 1, 4, 5]])


def three_tets_on_a_facet():
    points = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [0, 0, -1], [0.3, 0.3, 2.0]])
    return points, np.array([[0, 1, 2, 3], [0, 1, 2, 4], [0, 1, 2, 5]])


def folded_tets():
    points, cells = three_tets_on_a_facet()
    return points, cells[[0, 2]]


def flat_tet():
    return np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 1e-9]]), np.array([[0, 1, 2, 3]])


def repeated_tet():
    return np.vstack([np.zeros(3), np.eye(3)]), np.array([[0, 1, 2, 3], [1, 2, 3, 0]])


def infinite_point():
    points = np.vstack([np.zeros(3), np.eye(3)])
    points[2, 1] = np.inf
    return points, np.array([[0, 1, 2, 3]])


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (two_tets_sharing_an_edge, "2 pieces"),
        (three_tets_on_a_facet, "not a manifold"),
        (folded_tets, "overlap"),
        (flat_tet, "no volume"),
        (repeated_tet, "occur twice"),
        (infinite_point, "not finite"),
        (lambda: (np.zeros((4, 3)), np.zeros((0, 4), dtype=int)), "no cells"),
        (lambda: (np.zeros((4, 3)), np.array([[0, 1, 2, 7]])), "names node 7"),
        (lambda: (np.zeros((4, 3)), np.array([[0, 1, 2]])), "neither triangles in 2D nor tetrahedra in 3D"),
    ],
)
def test_bad_meshes_are_refused_with_a_reason(make, words):
    with pytest.raises(SoftprintError, match=words):
        oriented_mesh(*make(), source="bad.vtu")


@pytest.mark.parametrize("suffix", [".vtu", ".msh", ".vtk"])
@pytest.mark.parametrize("dim", [2, 3])
def test_mesh_files_round_trip(tmp_path, dim, suffix):
    mesh = small_box(dim)
    write_mesh(tmp_path / f"box{suffix}", mesh)
    again = read_mesh(tmp_path / f"box{suffix}")
    assert again.dim == dim
    np.testing.assert_allclose(again.points, mesh.points, atol=1e-6)  # written as float32
    np.testing.assert_array_equal(again.cells, mesh.cells)


def test_lower_cells_are_ignored_and_foreign_ones_refused(tmp_path):
    mesh = small_box(3)
    tets = ("tetra", mesh.cells)
    meshio.write(
        tmp_path / "gmsh.vtu",
        meshio.Mesh(mesh.points, [tets, ("triangle", mesh.facets), ("line", mesh.surface_edges)]),
    )
    assert read_mesh(tmp_path / "gmsh.vtu").n_cells == mesh.n_cells
    meshio.write(tmp_path / "mixed.vtu", meshio.Mesh(mesh.points, [tets, ("hexahedron", np.arange(8)[None])]))
    with pytest.raises(SoftprintError, match=r"mixes cells.*hexahedron"):
        read_mesh(tmp_path / "mixed.vtu")


def test_files_without_a_body_are_refused(tmp_path):
    mesh = small_box(3)
    meshio.write(tmp_path / "skin.vtu", meshio.Mesh(mesh.points, [("triangle", mesh.facets)]))
    with pytest.raises(SoftprintError, match="triangle surface in 3D"):
        read_mesh(tmp_path / "skin.vtu")
    meshio.write(tmp_path / "lines.vtu", meshio.Mesh(mesh.points, [("line", mesh.surface_edges)]))
    with pytest.raises(SoftprintError, match="holds line"):
        read_mesh(tmp_path / "lines.vtu")
    with pytest.raises(SoftprintError, match="no such mesh file"):
        read_mesh(tmp_path / "nowhere.vtu")
    (tmp_path / "text.vtu").write_text("this is not a mesh")
    (tmp_path / "text.unknown").write_text("this is not a mesh")
    write_mesh(tmp_path / "whole.vtu", mesh)
    (tmp_path / "cut.vtu").write_bytes((tmp_path / "whole.vtu").read_bytes()[:700])
    for name in ("text.vtu", "text.unknown", "cut.vtu"):
        with pytest.raises(SoftprintError, match=f"{name}.*cannot be read"):
            read_mesh(tmp_path / name)


@pytest.mark.parametrize(
    ("name", "dim", "least", "most"),
    [("jelly2d", 2, 13_500, 13_900), ("jelly3d_small", 3, 8_000, 15_000), ("jelly3d", 3, 58_000, 63_000)],
)
def test_committed_jellies_are_valid(request, name, dim, least, most):
    mesh = read_mesh(request.config.rootpath / "meshes" / f"{name}.vtu")
    assert mesh.dim == dim
    assert least <= mesh.n_cells <= most
    # 0.1 m wide, 0.06 m high, standing on zero; float32 coordinates and chords of the round side
    np.testing.assert_allclose(np.ptp(mesh.points, axis=0), [0.1] * (dim - 1) + [0.06], atol=2e-4)
    assert abs(mesh.points[:, -1].min()) < 1e-7
