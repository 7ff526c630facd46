"""The scale of the compliance: derivatives by finite differences, bounds, and what is invariant of it."""

import numpy as np

from softprint.runtime.colliders.pose import rotation_matrix
from softprint.runtime.contact.carriers.compliance_scale import N_COEFFICIENTS, ComplianceScale

SCALE = ComplianceScale((0.4, -0.9))


def strained(dim, seed=0, m=5, amount=0.2):
    """F (m, dim, dim) and unit normals (m, dim)."""
    rng = np.random.default_rng(seed)
    normal = rng.normal(size=(m, dim))
    F = np.eye(dim) + amount * rng.normal(size=(m, dim, dim))
    return F, normal / np.linalg.norm(normal, axis=1, keepdims=True)


def test_derivatives_by_the_deformation_gradient(dim):
    F, normal = strained(dim)
    found, h = SCALE.derivatives(F, normal), 1e-6
    for a, b in np.ndindex(dim, dim):
        change = np.zeros((dim, dim))
        change[a, b] = h
        ahead, behind = SCALE.derivatives(F + change, normal), SCALE.derivatives(F - change, normal)
        # Central differences over 1e-6 of smooth functions: 1e-10 of their size, and round-off of 1e-16 / 1e-6.
        slope = (np.log(ahead.scale) - np.log(behind.scale)) / (2 * h)
        np.testing.assert_allclose(found.slope[:, a, b], slope, atol=1e-8)
        np.testing.assert_allclose(
            found.curvature[:, :, :, a, b], (ahead.slope - behind.slope) / (2 * h), atol=1e-8
        )


def test_derivatives_by_the_coefficients(dim):
    F, normal = strained(dim)
    by_theta, by_slope = SCALE.by_coefficients(F, normal)
    for k in range(N_COEFFICIENTS):
        h = 1e-6 * np.eye(N_COEFFICIENTS)[k]
        c = np.array(SCALE.coefficients)
        ahead, behind = (ComplianceScale(tuple(c + side * h)).derivatives(F, normal) for side in (1, -1))
        # As above.
        np.testing.assert_allclose(
            by_theta[:, k], (np.log(ahead.scale) - np.log(behind.scale)) / 2e-6, atol=1e-8
        )
        np.testing.assert_allclose(by_slope[:, k], (ahead.slope - behind.slope) / 2e-6, atol=1e-8)


def test_rotating_the_body_changes_nothing(dim):
    F, normal = strained(dim)
    Q = rotation_matrix([0.7] if dim == 2 else [0.2, -0.4, 1.1], dim)
    # Round-off.
    np.testing.assert_allclose(SCALE.scale(Q @ F, normal), SCALE.scale(F, normal), rtol=1e-12)


def test_a_body_at_rest_has_its_compliance(dim):
    rotated = np.broadcast_to(rotation_matrix([0.7] if dim == 2 else [0.2, -0.4, 1.1], dim), (3, dim, dim))
    normal = np.tile(np.eye(dim)[0], (3, 1))
    # Round-off.
    np.testing.assert_allclose(SCALE.scale(rotated, normal), 1.0, rtol=1e-12)


def test_absurd_coefficients_stay_within_the_bound(dim):
    """So that the energy of contact stays positive and finite, whatever is learned."""
    F, normal = strained(dim, amount=3.0)
    absurd = ComplianceScale((-1e9, 1e12)).derivatives(F, normal)
    assert (absurd.scale >= np.exp(-1.0)).all()
    assert (absurd.scale <= np.exp(1.0)).all()
    assert np.isfinite(absurd.slope).all()
