"""Carriers of displacements at rest: rotations and their derivatives by finite differences, what is invariant of them,
and what becomes of them where the body is flattened or turned inside out."""

import numpy as np
import pytest

from softprint.runtime.body.rotations import nearest_rotation
from softprint.runtime.colliders.pose import rotation_matrix
from softprint.runtime.contact.carriers.point_rotations import (
    PointRotations,
    carried_along,
    pulled_back_along,
)

# Central differences over 1e-6 of smooth functions: 1e-10 of their size, and round-off of 1e-16 / 1e-6.
TOLERANCE, STEP = 1e-7, 1e-6


def strained(dim, m=5, amount=0.2):
    """F (m, dim, dim)."""
    return np.eye(dim) + amount * np.random.default_rng(0).normal(size=(m, dim, dim))


def difference(function, F, a, b):
    change = np.zeros(F.shape[1:])
    change[a, b] = STEP
    return (function(F + change) - function(F - change)) / (2.0 * STEP)


def test_rotations_are_those_of_the_polar_decomposition(dim):
    F = strained(dim, amount=0.3)
    found = PointRotations(F).value
    np.testing.assert_allclose(found, [nearest_rotation(one) for one in F], atol=1e-12)


def test_derivatives_by_the_deformation_gradient(dim):
    F = strained(dim, amount=0.3)
    moments = np.random.default_rng(3).normal(size=F.shape)
    found = PointRotations(F)
    bent, pulled = found.curvature(moments), found.pulled_back(moments)
    np.testing.assert_allclose(pulled, np.einsum("mab,mabcd->mcd", moments, found.slope), atol=1e-12)
    for a, b in np.ndindex(dim, dim):
        slope = difference(lambda at: PointRotations(at).value, F, a, b)
        np.testing.assert_allclose(found.slope[..., a, b], slope, atol=TOLERANCE)
        curvature = difference(lambda at: PointRotations(at).pulled_back(moments), F, a, b)
        np.testing.assert_allclose(bent[..., a, b], curvature, atol=TOLERANCE)


def test_motions_by_the_handle_rows(dim):
    rng, n_rows = np.random.default_rng(1), 4
    gradient, rows = rng.normal(size=(5, n_rows, dim)), 0.2 * rng.normal(size=(n_rows, dim))
    rows[:dim] += np.linalg.lstsq(gradient[0, :dim].T, np.eye(dim), rcond=None)[0]
    gradient[1:] = gradient[0] + 0.1 * gradient[1:]
    v, f = rng.normal(size=(2, 5, dim))

    def at(moved):
        return PointRotations(np.einsum("ra,mrj->maj", moved, gradient))

    turned = at(rows).by_rows(gradient)
    for column, (r, a) in enumerate(np.ndindex(n_rows, dim)):
        change = np.zeros_like(rows)
        change[r, a] = STEP
        slope = (at(rows + change).value - at(rows - change).value) / (2.0 * STEP)
        np.testing.assert_allclose(turned[..., column], slope, atol=TOLERANCE)
        along, back = carried_along(turned, v), pulled_back_along(turned, f)
        np.testing.assert_allclose(along[:, column], np.einsum("mab,mb->ma", slope, v).ravel(), atol=TOLERANCE)
        np.testing.assert_allclose(back[:, column], np.einsum("mab,ma->mb", slope, f).ravel(), atol=TOLERANCE)


def test_carriers_turn_with_the_body_and_not_with_its_strain(dim):
    """R(Q F) = Q R(F); and R is the same however far R S is stretched by S."""
    F = strained(dim)
    Q = rotation_matrix(np.full(1 if dim == 2 else 3, 0.8), dim)
    found, turned = PointRotations(F).value, PointRotations(Q @ F).value
    np.testing.assert_allclose(turned, Q @ found, atol=1e-12)
    stretch = np.diag(np.linspace(0.4, 1.5, dim))
    np.testing.assert_allclose(PointRotations((Q @ stretch)[None]).value[0], Q, atol=1e-12)


@pytest.mark.parametrize("least", [0.0, -0.3, -1.0])
def test_derivatives_stay_bounded_where_a_cell_is_flat_or_turned_inside_out(dim, least):
    singular = np.ones(dim)
    singular[-1] = least
    found = PointRotations(np.diag(singular)[None])
    R = found.value[0]
    np.testing.assert_allclose(R @ R.T, np.eye(dim), atol=1e-12)
    assert np.linalg.det(R) == pytest.approx(1.0)
    # 1 / least eigenvalue of K, at most 1 / 0.1.
    assert np.abs(found.slope).max() <= 10.0
    assert np.isfinite(found.curvature(np.ones((1, dim, dim)))).all()
