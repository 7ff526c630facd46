"""Materials: finite differences, small strain, invariance, closed forms, and plane strain."""

import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.spatial.transform import Rotation

from runtime.elasticity import make_material
from runtime.elasticity.invariants import cofactor, determinant
from runtime.errors import SoftprintError
from runtime.experiment import MaterialSpec

MODELS = ["stable_neo_hookean", "neo_hookean", "isochoric_neo_hookean", "linear"]
YOUNG, POISSON = 1e5, 0.46
STEP = 1e-6  # of central differences: relative errors near 1e-10
DIFFERENCE = 1e-8


def stretches(dim, rng):
    """Deformation gradients near and far from rest, all with J > 0."""
    F = np.eye(dim) + 0.25 * rng.normal(size=(40, dim, dim))
    return F[np.linalg.det(F) > 0.1]


def unit_differences(function, F):
    """d function / d F_kl by central differences, the new axes last."""
    dim = F.shape[-1]
    columns = []
    for k in range(dim):
        for m in range(dim):
            step = np.zeros((dim, dim))
            step[k, m] = STEP
            columns.append((function(F + step) - function(F - step)) / (2 * STEP))
    stacked = np.stack(columns, axis=-1)
    return stacked.reshape(*stacked.shape[:-1], dim, dim)


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("model", MODELS)
def test_stress_and_tangent_are_derivatives(model, dim):
    F = stretches(dim, np.random.default_rng(0))
    material = make_material(model, np.linspace(1e4, 1e6, len(F)), np.linspace(0.1, 0.49, len(F)))
    scale = material.young[:, None, None]
    stress = unit_differences(material.energy_density, F)
    np.testing.assert_allclose(material.first_piola(F) / scale, stress / scale, atol=DIFFERENCE * 10)
    tangent = unit_differences(material.first_piola, F)
    scale = np.abs(tangent).max()
    np.testing.assert_allclose(material.tangent(F) / scale, tangent / scale, atol=DIFFERENCE)
    np.testing.assert_allclose(
        material.tangent(F), material.tangent(F).transpose(0, 3, 4, 1, 2), rtol=1e-12, atol=1e-6
    )


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("model", MODELS)
def test_rest_is_free_of_energy_and_stress_and_stiff_as_hookes_law(model, dim):
    material = make_material(model, YOUNG, POISSON)
    rest = np.eye(dim)[None]
    # Round-off of sums of terms of size E.
    assert abs(material.energy_density(rest)[0]) < 1e-10
    assert np.abs(material.first_piola(rest)).max() < 1e-9
    mu, lam, eye = material.lame_mu, material.lame_lambda, np.eye(dim)
    hooke = lam * np.einsum("ij,kl", eye, eye) + mu * (
        np.einsum("ik,jl", eye, eye) + np.einsum("il,jk", eye, eye)
    )
    np.testing.assert_allclose(material.tangent(rest)[0], hooke, atol=1e-9 * YOUNG)


@pytest.mark.parametrize("model", MODELS)
def test_small_uniaxial_strain_gives_young_and_poisson(model):
    material, stretch = make_material(model, YOUNG, POISSON), 1.0 + 1e-6
    lateral, stress = uniaxial(material, stretch)
    assert stress / 1e-6 == pytest.approx(YOUNG, rel=1e-5)  # the law is nonlinear: its next order is 1e-6
    assert (1.0 - lateral) / 1e-6 == pytest.approx(POISSON, rel=1e-5)


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("model", MODELS[:-1])
def test_rotations_change_nothing(model, dim):
    rng = np.random.default_rng(1)
    F, material = stretches(dim, rng), make_material(model, YOUNG, POISSON)
    vector = rng.normal(size=3) if dim == 3 else np.array([0.0, 0.0, 1.1])
    turn = Rotation.from_rotvec(vector).as_matrix()[:dim, :dim]
    np.testing.assert_allclose(material.energy_density(turn @ F), material.energy_density(F), rtol=1e-10)
    np.testing.assert_allclose(material.energy_density(F @ turn), material.energy_density(F), rtol=1e-10)
    np.testing.assert_allclose(
        material.first_piola(turn @ F), turn @ material.first_piola(F), atol=1e-8 * YOUNG
    )


@pytest.mark.parametrize("model", MODELS)
def test_two_dimensions_are_plane_strain(model):
    flat = stretches(2, np.random.default_rng(2))
    solid = np.tile(np.eye(3), (len(flat), 1, 1))
    solid[:, :2, :2] = flat
    material = make_material(model, YOUNG, POISSON)
    near = {"rtol": 1e-11, "atol": 1e-9 * YOUNG}  # the same sums in another order
    np.testing.assert_allclose(material.energy_density(flat), material.energy_density(solid), **near)
    np.testing.assert_allclose(material.first_piola(flat), material.first_piola(solid)[:, :2, :2], **near)
    np.testing.assert_allclose(material.tangent(flat), material.tangent(solid)[:, :2, :2, :2, :2], **near)


def uniaxial(material, stretch):
    """Lateral stretch and axial first Piola stress [Pa] of a free bar."""

    def stress(lateral):
        return material.first_piola(np.diag([stretch, lateral, lateral])[None])[0]

    lateral = brentq(lambda a: stress(a)[1, 1], 0.3, 3.0, xtol=1e-15)
    return lateral, stress(lateral)[0, 0]


@pytest.mark.parametrize(
    ("stretch", "lateral", "stress"), [(2.0, 0.71971603, 66327.2507), (0.5, 1.34841608, -113907.988)]
)
def test_stable_neo_hookean_bar(stretch, lateral, stress):
    """The free bar under uniaxial stretch, solved for the law with the origin barrier log(I_C + 1)."""
    found = uniaxial(make_material("stable_neo_hookean", YOUNG, POISSON), stretch)
    assert found == pytest.approx((lateral, stress), rel=1e-8)  # the figures are given to nine digits


@pytest.mark.parametrize("dim", [2, 3])
def test_stable_neo_hookean_is_finite_when_inverted_and_the_logarithmic_laws_are_not(dim):
    inverted = np.diag([-1.0, 1.0, 1.0][:dim])[None]
    stable, *logarithmic = (make_material(model, YOUNG, POISSON) for model in MODELS[:3])
    assert 0 < stable.energy_density(inverted)[0] < np.inf
    assert np.isfinite(stable.first_piola(inverted)).all()
    assert np.isfinite(stable.tangent(np.zeros((1, dim, dim)))).all()
    for material in logarithmic:
        assert material.energy_density(inverted)[0] == np.inf


@pytest.mark.parametrize("dim", [2, 3])
def test_determinant_and_its_derivative(dim):
    F = np.random.default_rng(3).normal(size=(20, dim, dim))
    np.testing.assert_allclose(determinant(F), np.linalg.det(F), atol=1e-13)
    np.testing.assert_allclose(cofactor(F), unit_differences(determinant, F), atol=DIFFERENCE)


@pytest.mark.parametrize("model", MODELS)
def test_every_model_may_stand_in_an_experiment(model):
    assert MaterialSpec(model=model, young=YOUNG, poisson=POISSON).model == model


def test_parameters_for_each_cell_are_taken_by_cell():
    material = make_material("neo_hookean", np.array([1.0, 2.0, 3.0]), 0.3)
    some = material.at(np.array([2, 0]))
    np.testing.assert_array_equal(some.young, [3.0, 1.0])
    F = np.tile(np.diag([1.1, 1.0]), (2, 1, 1))
    densities = some.energy_density(F)
    assert densities[0] == pytest.approx(3 * densities[1])


@pytest.mark.parametrize(
    ("model", "young", "poisson", "words"),
    [
        ("jelly", 1e4, 0.3, "unknown model 'jelly'; known are stable_neo_hookean"),
        ("linear", 0.0, 0.3, "Young's modulus must be positive"),
        ("linear", np.nan, 0.3, "Young's modulus must be positive"),
        ("linear", 1e4, 0.5, "Poisson's ratio must lie between.*0.5"),
        ("linear", 1e4, np.array([0.3, -1.2]), "it is -1.2"),
    ],
)
def test_impossible_parameters_are_refused(model, young, poisson, words):
    with pytest.raises(SoftprintError, match=words):
        make_material(model, young, poisson)
