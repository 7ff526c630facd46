"""What is kept of the compliance among nodes is what it is a copy of, whichever nodes were asked for before."""

import tracemalloc
from multiprocessing.reduction import ForkingPickler

import numpy as np
import pytest

from softprint.runtime.body import assemble_body, frame_in_box, place_handles
from softprint.runtime.elasticity.materials import make_material
from softprint.runtime.mechanics.body_mechanics import compute_mechanics
from softprint.runtime.mechanics.compliance.local_compliance import LocalCompliance
from softprint.runtime.mesh.box import box_mesh

N_NODES = 900  # more than are kept at once


@pytest.fixture(params=[2, 3])
def all_pairs(request):
    """[i, j] = G_ij, random and symmetric."""
    rng = np.random.default_rng(1)
    pairs = rng.normal(size=(N_NODES, N_NODES, request.param, request.param)).astype(np.float32)
    return pairs + pairs.transpose(1, 0, 3, 2)


def test_what_is_kept_is_what_was_asked_for(all_pairs):
    compliance, dim = LocalCompliance(all_pairs), all_pairs.shape[2]
    rng = np.random.default_rng(2)
    for count in (5, 100, 150, 200, 390, 40):
        nodes = np.sort(rng.choice(N_NODES, count, replace=False))
        at = np.sort(rng.choice(N_NODES, 20, replace=False))
        forces = rng.normal(size=(count, dim))
        size = count * dim
        expected = all_pairs[np.ix_(nodes, nodes)].transpose(0, 2, 1, 3).reshape(size, size)
        np.testing.assert_array_equal(compliance.among(nodes), expected)
        np.testing.assert_array_equal(compliance.among(nodes), expected)  # now the one that was kept
        moved = np.einsum("ijcd,jd->ic", all_pairs[np.ix_(at, nodes)], forces)
        # Sums of float64 products, in another order.
        np.testing.assert_allclose(compliance.displacement(at, nodes, forces), moved, rtol=1e-9, atol=1e-9)


def test_the_displacement_of_many_nodes_copies_nothing(all_pairs):
    """A copy of all pairs takes seconds for a body of the thesis's size."""
    compliance, everyone, nodes = LocalCompliance(all_pairs), np.arange(N_NODES), np.arange(3, 90, 4)
    forces = np.random.default_rng(4).normal(size=(len(nodes), all_pairs.shape[2]))
    moved = np.einsum("ijcd,jd->ic", all_pairs[:, nodes], forces)
    compliance.displacement(everyone, nodes, forces)  # compiled
    tracemalloc.start()
    found = compliance.displacement(everyone, nodes, forces)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 0.1 * all_pairs.nbytes
    # Sums of float64 products, in another order.
    np.testing.assert_allclose(found, moved, rtol=1e-9, atol=1e-9)


def test_a_copy_in_another_process_keeps_nothing_but_finds_the_same(all_pairs):
    compliance, nodes = LocalCompliance(all_pairs), np.arange(0, N_NODES, 7)
    before = compliance.among(nodes)
    again = ForkingPickler.loads(ForkingPickler.dumps(compliance))
    np.testing.assert_array_equal(again.among(nodes), before)
    assert len(ForkingPickler.dumps(compliance)) < 1.01 * all_pairs.nbytes


@pytest.mark.parametrize("points", [0, 2, 8])
def test_no_node_is_displaced_farther(points, dim):
    """By loads on neighbouring nodes of a beam that is held at its end. Without points the free end goes seven
    times as far as the nodes that bear them."""
    upper, cells = [0.2, 0.02, 0.02][:dim], [24, 3, 3][:dim]
    mesh = box_mesh([0.0] * dim, upper, cells)
    frame = frame_in_box(mesh, "base", [[-1.0] * dim, [0.04] + [1.0] * (dim - 1)])
    material = make_material("neo_hookean", 2e4, 0.4)
    body = assemble_body(mesh, place_handles(mesh, points, [frame]), material, 1000.0, name="beam")
    surface = compute_mechanics(body, 400, condensation=False).surface_compliance
    compliance, x = LocalCompliance(surface.among_nodes()), mesh.points[surface.nodes]
    rng, every = np.random.default_rng(0), np.arange(len(x))
    for _ in range(200):
        order = np.argsort(np.linalg.norm(x - x[rng.integers(len(x))], axis=1))
        nodes = np.sort(order[: rng.integers(1, 30)])
        forces = rng.normal(size=(1, dim)) + rng.normal(size=(len(nodes), dim))
        moved = np.linalg.norm(compliance.displacement(every, nodes, forces), axis=1).max()
        assert moved <= compliance.farthest(nodes, forces)
        assert compliance.farthest(nodes, forces) < 1.3 * moved  # the margin, and no more
