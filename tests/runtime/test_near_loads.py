"""What is kept of the compliance among loads is what it is a copy of, whichever loads were asked for before."""

import numpy as np
import pytest

from runtime.corrections.near_loads import NearLoads

N_LOADS = 600  # more than are kept at once


@pytest.fixture(params=[2, 3])
def among(request):
    """[i, j] = G_ij of random symmetric loads."""
    rng = np.random.default_rng(1)
    pairs = rng.normal(size=(N_LOADS, N_LOADS, request.param, request.param)).astype(np.float32)
    return pairs + pairs.transpose(1, 0, 3, 2)


def test_what_is_kept_is_what_was_asked_for(among):
    near, dim = NearLoads(among), among.shape[2]
    rng = np.random.default_rng(2)
    for count in (5, 100, 150, 200, 390, 40):
        loads = np.sort(rng.choice(N_LOADS, count, replace=False))
        at = np.sort(rng.choice(N_LOADS, 20, replace=False))
        F, forces = rng.normal(size=(count, dim, dim)), rng.normal(size=(count, dim))
        carried = np.einsum("iac,ijcd,jbd->iajb", F, among[np.ix_(loads, loads)], F, optimize=True)
        moved = np.einsum("iac,ijcd,jd->ia", F[:5], among[np.ix_(at[:5], loads)], forces, optimize=True)
        # Sums of float64 products, in another order.
        kept = near.carried(loads, F).reshape(carried.shape)
        np.testing.assert_allclose(kept, carried, rtol=1e-9, atol=1e-9)
        kept = near.displacement(at[:5], F[:5], loads, forces)
        np.testing.assert_allclose(kept, moved, rtol=1e-9, atol=1e-9)
