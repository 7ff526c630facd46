"""The third and fourth derivatives of energy densities at rest: against tangents of strained solids, of every material
and of many moduli."""

import numpy as np
import pytest

from softprint.runtime.elasticity.materials import make_material
from softprint.runtime.elasticity.rest_derivatives import RestDerivatives

MODELS = ["linear", "neo_hookean", "invertible_neo_hookean", "stable_neo_hookean", "isochoric_neo_hookean"]
YOUNG, POISSON = np.array([1e4, 3e5, 2e4]), np.array([0.3, 0.45, 0.1])


def gradients(dim, n, size):
    """H (n, dim^2)."""
    return size * np.random.default_rng(1).normal(size=(n, dim**2))


@pytest.mark.parametrize("model", MODELS)
def test_they_are_the_change_of_the_tangent(model, dim):
    """By its odd and even part along H, from two sizes of it, with other moduli in each cell."""
    material, k = make_material(model, YOUNG, POISSON), dim**2
    H = gradients(dim, len(YOUNG), 0.01)

    def parts(share):
        ahead, here, behind = (
            material.tangent(np.eye(dim) + side * share * H.reshape(-1, dim, dim)).reshape(-1, k, k)
            for side in (1.0, 0.0, -1.0)
        )
        return (ahead - behind) / (2.0 * share), (ahead - 2.0 * here + behind) / share**2

    (odd, even), (smaller_odd, smaller_even) = parts(1.0), parts(0.5)
    # Richardson's extrapolation.
    third, fourth = (4.0 * smaller_odd - odd) / 3.0, (4.0 * smaller_even - even) / 3.0
    of = RestDerivatives.of(material, dim)
    # Terms of the fifth and sixth derivative of strains of a hundredth; those of the differences.
    size = np.abs(make_material(model, YOUNG.max(), POISSON.max()).tangent(np.eye(dim)[None])).max()
    np.testing.assert_allclose(of.third_along(H), third, atol=1e-6 * size)
    np.testing.assert_allclose(of.fourth_along(H, H), fourth, atol=1e-6 * size)
    assert model == "linear" or np.abs(fourth).max() > 1e-4 * size


@pytest.mark.parametrize("model", MODELS)
def test_the_order_of_the_directions_does_not_matter(model, dim):
    of = RestDerivatives.of(make_material(model, 1e4, 0.4), dim)
    A, B, C = np.random.default_rng(2).normal(size=(3, 1, dim**2))
    found = [x[0] @ of.third_along(z)[0] @ y[0] for x, y, z in ((A, B, C), (B, C, A), (C, B, A))]
    # Round-off: they are symmetrised.
    assert found[1:] == pytest.approx(found[:1] * 2, abs=1e-8 * 1e4)
    np.testing.assert_allclose(of.fourth_along(A, B)[0] @ C[0], of.fourth_along(C, A)[0] @ B[0], atol=1e-8 * 1e4)
    crossed = [x[0] @ of.fourth_along(y, y)[0] @ x[0] for x, y in ((A, B), (B, A))]
    assert crossed[1] == pytest.approx(crossed[0], abs=1e-8 * 1e4)


@pytest.mark.parametrize("model", MODELS)
def test_many_cells_are_each_like_one(model, dim):
    H = gradients(dim, len(YOUNG), 0.2)
    of_all = RestDerivatives.of(make_material(model, YOUNG, POISSON), dim)
    for k in range(len(YOUNG)):
        for of in (
            RestDerivatives.of(make_material(model, YOUNG[k], POISSON[k]), dim),
            of_all.at(np.array([k])),
        ):
            # Round-off of differences over strains of 1e-4.
            np.testing.assert_allclose(of.third_along(H[[k]])[0], of_all.third_along(H)[k], atol=1e-9 * YOUNG[k])
            # Over 1e-3, twice.
            own, every = of.fourth_along(H[[k]], H[[k]])[0], of_all.fourth_along(H, H)[k]
            np.testing.assert_allclose(own, every, atol=1e-8 * YOUNG[k])


def test_a_linear_material_has_none(dim):
    """Its energy is quadratic in H, whatever its strain is."""
    of = RestDerivatives.of(make_material("linear", YOUNG, POISSON), dim)
    # Round-off of tangents over 1e-4, and over 1e-3 twice.
    H = gradients(dim, len(YOUNG), 1.0)
    assert np.abs(of.third_along(H)).max() < 1e-9 * YOUNG.max()
    assert np.abs(of.fourth_along(H, H)).max() < 1e-7 * YOUNG.max()


def test_rotating_strain_and_dent_together_changes_nothing(dim):
    of, rng = RestDerivatives.of(make_material("isochoric_neo_hookean", 1e4, 0.45), dim), np.random.default_rng(4)
    E, H = rng.normal(size=(2, 4, dim, dim))
    R, _ = np.linalg.qr(rng.normal(size=(dim, dim)))

    def Q(H, E):
        flat = H.reshape(len(H), -1)
        return np.einsum("na,nab,nb->n", flat, of.third_along(E.reshape(len(E), -1)), flat)

    # Third derivatives are differences over strains of 1e-4, to the square of it.
    found, here = Q(R @ H @ R.T, R @ E @ R.T), Q(H, E)
    np.testing.assert_allclose(found, here, atol=1e-6 * np.abs(here).max())


def test_a_small_rotation_on_top_does_no_work(dim):
    """By objectivity, T[H, H, w] = -2 D2Psi(I)[w H, H] for a small rotation w."""
    material, rng = make_material("invertible_neo_hookean", 1e4, 0.4), np.random.default_rng(5)
    w, H = rng.normal(size=(2, dim, dim))
    w = w - w.T
    tangent = material.tangent(np.eye(dim)[None]).reshape(dim**2, dim**2)
    along = RestDerivatives.of(material, dim).third_along(w.reshape(1, -1))[0]
    expected = -2.0 * (w @ H).ravel() @ tangent @ H.ravel()
    # Differences over strains of 1e-4.
    assert H.ravel() @ along @ H.ravel() == pytest.approx(expected, rel=1e-6)
