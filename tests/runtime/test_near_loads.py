"""What is kept of the compliance among loads is what it is a copy of, whichever loads were asked for before."""

import numpy as np
import pytest

from runtime.mechanics.local_compliance import LocalCompliance

N_LOADS = 600  # more than are kept at once


@pytest.fixture(params=[2, 3])
def among(request):
    """[i, j] = G_ij of random symmetric loads."""
    rng = np.random.default_rng(1)
    pairs = rng.normal(size=(N_LOADS, N_LOADS, request.param, request.param)).astype(np.float32)
    return pairs + pairs.transpose(1, 0, 3, 2)


def test_what_is_kept_is_what_was_asked_for(among):
    near, dim = LocalCompliance(among), among.shape[2]
    rng = np.random.default_rng(2)
    for count in (5, 100, 150, 200, 390, 40):
        loads = np.sort(rng.choice(N_LOADS, count, replace=False))
        at = np.sort(rng.choice(N_LOADS, 20, replace=False))
        forces = rng.normal(size=(count, dim))
        size = count * dim
        expected = among[np.ix_(loads, loads)].transpose(0, 2, 1, 3).reshape(size, size)
        np.testing.assert_array_equal(near.compliance(loads), expected)
        np.testing.assert_array_equal(near.compliance(loads), expected)  # now the one that was kept
        moved = np.einsum("ijcd,jd->ic", among[np.ix_(at, loads)], forces)
        # Sums of float64 products, in another order.
        np.testing.assert_allclose(near.displacement(at, loads, forces), moved, rtol=1e-9, atol=1e-9)
