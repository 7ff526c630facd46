"""Products with directions that are zero for the most part."""

import numpy as np

from softprint.runtime.linalg.sparse_directions import between_directions, times_directions


def test_only_zeros_are_skipped():
    rng = np.random.default_rng(0)
    T = rng.normal(size=(12, 7)) * (rng.random(size=(12, 7)) < 0.3)
    M, H = rng.normal(size=(5, 12)), rng.normal(size=(12, 12))
    # Sums of a dozen products of order one.
    np.testing.assert_allclose(times_directions(M, T), M @ T, atol=1e-14)
    np.testing.assert_allclose(between_directions(H, T), T.T @ H @ T, atol=1e-14)
    assert not times_directions(M, np.zeros((12, 3))).any()
