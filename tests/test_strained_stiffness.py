"""The stiffness under a strain: against tangents of strained solids, of every material and of many moduli."""

import numpy as np
import pytest

from softprint.runtime.elasticity.materials import make_material
from softprint.runtime.elasticity.strained_stiffness import (
    StrainedStiffness,
    n_strains,
    strain_components,
)

MODELS = ["linear", "neo_hookean", "invertible_neo_hookean", "stable_neo_hookean", "isochoric_neo_hookean"]
YOUNG, POISSON = np.array([1e4, 3e5, 2e4]), np.array([0.3, 0.45, 0.1])


def strains(dim, n, size):
    """E (n, dim, dim) and its components (n, s)."""
    E = size * np.random.default_rng(1).normal(size=(n, dim, dim))
    E = 0.5 * (E + np.swapaxes(E, 1, 2))
    return E, E[:, *strain_components(dim)]


@pytest.mark.parametrize("model", MODELS)
def test_it_is_the_change_of_the_tangent(model, dim):
    """By Richardson's extrapolation of one-sided differences, with other moduli in each cell."""
    material, size = make_material(model, YOUNG, POISSON), 1e-3
    E, components = strains(dim, len(YOUNG), size)
    k = dim**2

    def tangent(share):
        return material.tangent(np.eye(dim) + share * E).reshape(-1, k, k)

    once, half, quarter = ((tangent(share) - tangent(0.0)) / share for share in (1.0, 0.5, 0.25))
    found = StrainedStiffness.of(material, dim).stiffness(components)
    # What is left is of fourth order in a strain of some thousandths, and round-off over a quarter of it.
    near = 1e-6 * size * np.abs(tangent(0.0)).max()
    np.testing.assert_allclose(found, (once - 6.0 * half + 8.0 * quarter) / 3.0, atol=near)
    np.testing.assert_allclose(found, found.transpose(0, 2, 1), atol=1e-3 * near)


@pytest.mark.parametrize("model", MODELS)
def test_many_cells_are_each_like_one(model, dim):
    _, E = strains(dim, len(YOUNG), 0.2)
    of_all = StrainedStiffness.of(make_material(model, YOUNG, POISSON), dim)
    H = np.random.default_rng(2).normal(size=(len(E), dim * dim))
    for k in range(len(YOUNG)):
        for of in (
            StrainedStiffness.of(make_material(model, YOUNG[k], POISSON[k]), dim),
            of_all.at(np.array([k])),
        ):
            # Round-off of differences over strains of 1e-4.
            near = 1e-9 * YOUNG[k]
            np.testing.assert_allclose(of.stiffness(E[[k]])[0], of_all.stiffness(E)[k], atol=near)
            for one, every in zip(of.by_strain(H[[k]]), of_all.by_strain(H), strict=True):
                np.testing.assert_allclose(one[0], every[k], atol=near)


def test_derivatives_of_the_energy_density(dim):
    """Q = 1/2 H : B(E) : H is linear in E and quadratic in H."""
    of = StrainedStiffness.of(make_material("stable_neo_hookean", 1e4, 0.4), dim)
    _, E = strains(dim, 4, 0.3)
    rng = np.random.default_rng(3)
    H, dH, dE = rng.normal(size=(4, dim**2)), rng.normal(size=(4, dim**2)), rng.normal(size=E.shape)

    def Q(H, E):
        return 0.5 * np.einsum("na,nab,nb->n", H, of.stiffness(E), H)

    by_E, mixed = of.by_strain(H)
    assert by_E.shape == (4, n_strains(dim))
    # Round-off: differences of polynomials of first order in E, and of second order in H.
    np.testing.assert_allclose((by_E * dE).sum(axis=1), Q(H, E + dE) - Q(H, E), rtol=1e-9)
    both = Q(H + dH, E + dE) - Q(H + dH, E) - Q(H - dH, E + dE) + Q(H - dH, E)
    np.testing.assert_allclose(np.einsum("ns,nsa,na->n", dE, mixed, dH), 0.5 * both, rtol=1e-9)


def test_a_linear_material_does_not_change(dim):
    """Its energy is quadratic in H, whatever its strain is."""
    of = StrainedStiffness.of(make_material("linear", YOUNG, POISSON), dim)
    # Round-off of tangents over 1e-4.
    assert np.abs(of.stiffness(strains(dim, len(YOUNG), 1.0)[1])).max() < 1e-9 * YOUNG.max()


def test_rotating_strain_and_dent_together_changes_nothing(dim):
    of = StrainedStiffness.of(make_material("isochoric_neo_hookean", 1e4, 0.45), dim)
    E, _ = strains(dim, 4, 0.2)
    rng = np.random.default_rng(4)
    H = rng.normal(size=E.shape)
    R, _ = np.linalg.qr(rng.normal(size=(dim, dim)))

    def Q(H, E):
        flat = H.reshape(len(H), -1)
        return np.einsum("na,nab,nb->n", flat, of.stiffness(E[:, *strain_components(dim)]), flat)

    # Third derivatives are differences over strains of 1e-4, to the square of it.
    np.testing.assert_allclose(Q(R @ H @ R.T, R @ E @ R.T), Q(H, E), rtol=1e-6)
