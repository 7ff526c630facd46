"""What is kept of the compliance among nodes is what it is a copy of, whichever nodes were asked for before."""

import tracemalloc
from multiprocessing.reduction import ForkingPickler

import numpy as np
import pytest

from softprint.runtime.mechanics.compliance.local_compliance import LocalCompliance

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
