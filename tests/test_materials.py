"""Every registered material: derivatives, rest, small strain, invariance, plane strain, and runtime against UFL.

All tests with the argument `model` iterate over `MATERIALS`, so that a new material is tested automatically.
"""

import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.spatial.transform import Rotation

from softprint.runtime.elasticity import MATERIALS, make_material
from softprint.runtime.elasticity.elastic_energy import elastic_gradient
from softprint.runtime.elasticity.invariants import cofactor, determinant
from softprint.runtime.elasticity.materials.invertible_neo_hookean import CONTINUED
from softprint.runtime.errors import SoftprintError
from softprint.runtime.experiment import MaterialSpec
from softprint.runtime.experiment.describe import described_keys
from softprint.runtime.fields.tensors import cauchy_stress, von_mises
from softprint.runtime.mesh import Mesh, box_mesh

YOUNG, POISSON = 1e5, 0.46
STEP = 1e-6  # of central differences: relative errors near 1e-10
DIFFERENCE = 1e-8
ROUND_OFF = 1e-12  # sums of some ten float64 products
every_model = pytest.mark.parametrize("model", MATERIALS)


def stretches(dim, rng):
    """Deformation gradients near rest and far from it, all with J > 0."""
    F = np.eye(dim) + 0.25 * rng.normal(size=(40, dim, dim))
    return F[np.linalg.det(F) > 0.1]


def graded(model, count):
    """A material with different moduli for each deformation gradient."""
    return make_material(model, np.linspace(1e4, 1e6, count), np.linspace(0.1, 0.49, count))


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


def uniaxial(material, stretch):
    """Lateral stretch and axial first Piola stress [Pa] of a free bar."""

    def stress(lateral):
        return material.first_piola(np.diag([stretch, lateral, lateral])[None])[0]

    lateral = brentq(lambda a: stress(a)[1, 1], 0.3, 3.0, xtol=1e-15)
    return lateral, stress(lateral)[0, 0]


@every_model
def test_the_name_is_that_of_the_file_and_valid_in_an_experiment(model):
    assert MATERIALS[model].model == model
    assert MaterialSpec(model=model, young=YOUNG, poisson=POISSON).model == model
    assert any(f'"{model}"' in kind for _, kind, _ in described_keys(MaterialSpec))


def test_ufl_has_the_same_materials():
    pytest.importorskip("ufl")
    from softprint.fem_truth.elasticity.energy_densities import DENSITIES
    from softprint.fem_truth.elasticity.native_elasticity import KERNELS

    assert set(DENSITIES) == set(MATERIALS)
    assert set(MATERIALS) >= KERNELS


@every_model
def test_energy_stress_and_tangent_are_those_of_the_ufl_density(model, dim):
    """On simplices that share no node, so that each has its own deformation gradient."""
    pytest.importorskip("dolfinx")
    from softprint.fem_truth.elasticity.form_elasticity import FormElasticity

    F = stretches(dim, np.random.default_rng(4))
    count, material = len(F), graded(model, len(F))
    # Corners at the origin and at the unit vectors: the gradients of their hat functions are the unit vectors too.
    simplex = np.vstack([np.zeros(dim), np.eye(dim)])
    away = 2.0 * np.arange(count)[:, None, None] * np.eye(dim)[0]
    mesh = Mesh(
        (simplex + away).reshape(-1, dim),
        np.arange(count * (dim + 1)).reshape(count, dim + 1),
    )
    x = (simplex @ F.transpose(0, 2, 1) + away).reshape(-1, dim)
    volume = mesh.cell_volumes[0]
    form = FormElasticity(mesh, material)

    energy, gradient = form.energy_gradient(x)
    density = material.energy_density(F)
    assert energy == pytest.approx(volume * density.sum(), rel=ROUND_OFF)
    # The force on corner j + 1 is volume P e_j. Positions of up to 80 m cost two digits.
    stress = gradient.reshape(count, dim + 1, dim)[:, 1:].transpose(0, 2, 1) / volume
    expected = material.first_piola(F)
    scale = np.abs(expected).max(axis=(1, 2), keepdims=True)
    np.testing.assert_allclose(stress / scale, expected / scale, atol=100 * ROUND_OFF)
    both_energy, both_stress = material.energy_and_stress(F)
    np.testing.assert_array_equal(both_energy, density)
    np.testing.assert_array_equal(both_stress, expected)

    tangent, dense = material.tangent(F), form.hessian(x).sparse().toarray()
    size = dim * (dim + 1)
    for c in range(count):
        block = dense[c * size : (c + 1) * size, c * size : (c + 1) * size].reshape([dim + 1, dim] * 2)
        found = block[1:, :, 1:, :].transpose(1, 0, 3, 2) / volume  # rows (j, i), columns (l, k)
        np.testing.assert_allclose(found, tangent[c], atol=100 * ROUND_OFF * np.abs(tangent[c]).max())


@every_model
def test_stress_and_tangent_are_derivatives(model, dim):
    F = stretches(dim, np.random.default_rng(0))
    material = graded(model, len(F))
    scale = material.young[:, None, None]
    stress = unit_differences(material.energy_density, F)
    np.testing.assert_allclose(material.first_piola(F) / scale, stress / scale, atol=DIFFERENCE * 10)
    tangent = unit_differences(material.first_piola, F)
    scale = np.abs(tangent).max()
    np.testing.assert_allclose(material.tangent(F) / scale, tangent / scale, atol=DIFFERENCE)
    np.testing.assert_allclose(
        material.tangent(F), material.tangent(F).transpose(0, 3, 4, 1, 2), rtol=1e-12, atol=1e-6
    )


@every_model
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


@every_model
def test_small_uniaxial_strain_gives_young_and_poisson(model):
    material, stretch = make_material(model, YOUNG, POISSON), 1.0 + 1e-6
    lateral, stress = uniaxial(material, stretch)
    assert stress / 1e-6 == pytest.approx(YOUNG, rel=1e-5)  # the law is nonlinear: its next order is 1e-6
    assert (1.0 - lateral) / 1e-6 == pytest.approx(POISSON, rel=1e-5)


@every_model
def test_small_simple_shear_gives_the_shear_modulus(model):
    gamma, young, poisson = 1e-6, 1e5, 0.3
    F = np.eye(3)[None] + gamma * np.array([[[0.0, 1, 0], [0, 0, 0], [0, 0, 0]]])
    stress = cauchy_stress(make_material(model, young, poisson), F)[0]
    assert stress[0, 1] == pytest.approx(gamma * young / 2.6, rel=1e-5)  # terms of second order: 1e-6
    assert von_mises(stress[None])[0] == pytest.approx(np.sqrt(3) * gamma * young / 2.6, rel=1e-5)


@pytest.mark.parametrize("model", [name for name, kind in MATERIALS.items() if kind.rotation_invariant])
def test_rotations_change_nothing(model, dim):
    rng = np.random.default_rng(1)
    F, material = stretches(dim, rng), make_material(model, YOUNG, POISSON)
    vector = rng.normal(size=3) if dim == 3 else np.array([0.0, 0.0, 1.1])
    rotation = Rotation.from_rotvec(vector).as_matrix()[:dim, :dim]
    np.testing.assert_allclose(material.energy_density(rotation @ F), material.energy_density(F), rtol=1e-10)
    np.testing.assert_allclose(material.energy_density(F @ rotation), material.energy_density(F), rtol=1e-10)
    np.testing.assert_allclose(
        material.first_piola(rotation @ F), rotation @ material.first_piola(F), atol=1e-8 * YOUNG
    )


@every_model
def test_two_dimensions_are_plane_strain(model):
    flat = stretches(2, np.random.default_rng(2))
    solid = np.tile(np.eye(3), (len(flat), 1, 1))
    solid[:, :2, :2] = flat
    material = make_material(model, YOUNG, POISSON)
    near = {"rtol": 1e-11, "atol": 1e-9 * YOUNG}  # the same sums in another order
    np.testing.assert_allclose(material.energy_density(flat), material.energy_density(solid), **near)
    np.testing.assert_allclose(material.first_piola(flat), material.first_piola(solid)[:, :2, :2], **near)
    np.testing.assert_allclose(material.tangent(flat), material.tangent(solid)[:, :2, :2, :2, :2], **near)


@every_model
def test_inverted_energy_is_finite_or_infinite_as_declared(model, dim):
    material = make_material(model, YOUNG, POISSON)
    inverted, flat = np.diag([-1.2, 1.0, 1.0][:dim])[None], np.zeros((1, dim, dim))
    if material.finite_if_inverted:
        assert 0 < material.energy_density(inverted)[0] < np.inf
        assert np.isfinite(material.first_piola(inverted)).all()
        assert np.isfinite(material.tangent(flat)).all()
    else:
        assert material.energy_density(inverted)[0] == np.inf


@every_model
def test_affine_patch_has_no_inner_forces(model, dim):
    mesh = box_mesh([0.0] * dim, [1.0] * dim, [3] * dim)
    stretch = np.eye(dim) + 0.1 * np.random.default_rng(1).normal(size=(dim, dim))
    forces = elastic_gradient(mesh, make_material(model, 1.0, 0.4), mesh.points @ stretch.T)
    inner = np.setdiff1d(np.arange(mesh.n_nodes), mesh.surface_nodes)
    assert np.abs(forces[inner]).max() < 1e-14 * mesh.n_nodes  # round-off
    assert np.abs(forces[mesh.surface_nodes]).max() > 1e-3


@every_model
def test_parameters_per_cell(model):
    material = make_material(model, np.array([1.0, 2.0, 3.0]), 0.3)
    some = material.at(np.array([2, 0]))
    np.testing.assert_array_equal(some.young, [3.0, 1.0])
    F = np.tile(np.diag([1.1, 1.0]), (2, 1, 1))
    densities = some.energy_density(F)
    assert densities[0] == pytest.approx(3 * densities[1])


def test_the_continued_logarithm_is_that_of_neo_hookean_where_the_volume_is_not_small(dim):
    F = stretches(dim, np.random.default_rng(5))
    F = F[np.linalg.det(F) > CONTINUED]
    ours, theirs = (
        make_material(model, YOUNG, POISSON) for model in ("invertible_neo_hookean", "neo_hookean")
    )
    near = {"rtol": 1e-11, "atol": 1e-10 * YOUNG}  # the same sums in another order
    np.testing.assert_allclose(ours.energy_density(F), theirs.energy_density(F), **near)
    np.testing.assert_allclose(ours.first_piola(F), theirs.first_piola(F), **near)
    np.testing.assert_allclose(ours.tangent(F), theirs.tangent(F), **near)


def test_the_continued_logarithm_has_two_continuous_derivatives(dim):
    material, off = make_material("invertible_neo_hookean", YOUNG, POISSON), 1e-9
    F = np.stack([np.diag([CONTINUED * (1 + side * off), 1.0, 1.0][:dim]) for side in (-1, 1)])
    for part in (material.energy_density, material.first_piola, material.tangent):
        below, above = part(F)
        # The third derivative is some hundred times the tangent.
        np.testing.assert_allclose(below, above, atol=1e-6 * np.abs(above).max())


def test_a_crushed_cell_resists_ever_more_until_it_is_inverted():
    """The thinner a cell is that cannot widen, the more it presses; where it is flat several times as much as one of a
    stable neo-Hookean solid."""
    thickness = np.linspace(1.0, -0.5, 151)
    F = np.tile(np.eye(3), (len(thickness), 1, 1))
    F[:, 2, 2] = thickness
    pressure = -make_material("invertible_neo_hookean", YOUNG, 0.4).first_piola(F)[:, 2, 2]
    assert (np.diff(pressure) > 0.0).all()
    flat = F[100:101]
    assert thickness[100] == pytest.approx(0.0, abs=1e-12)
    stable = -make_material("stable_neo_hookean", YOUNG, 0.4).first_piola(flat)[0, 2, 2]
    assert pressure[100] > 8.0 * stable


@pytest.mark.parametrize(
    ("stretch", "lateral", "stress"), [(2.0, 0.71971603, 66327.2507), (0.5, 1.34841608, -113907.988)]
)
def test_stable_neo_hookean_bar(stretch, lateral, stress):
    """The free bar under uniaxial stretch, solved for the law with the origin barrier log(I_C + 1)."""
    found = uniaxial(make_material("stable_neo_hookean", YOUNG, POISSON), stretch)
    assert found == pytest.approx((lateral, stress), rel=1e-8)  # the reference values have nine digits


def test_determinant_and_its_derivative(dim):
    F = np.random.default_rng(3).normal(size=(20, dim, dim))
    np.testing.assert_allclose(determinant(F), np.linalg.det(F), atol=1e-13)
    np.testing.assert_allclose(cofactor(F), unit_differences(determinant, F), atol=DIFFERENCE)


@pytest.mark.parametrize(
    ("model", "young", "poisson", "words"),
    [
        ("jelly", 1e4, 0.3, f"unknown model 'jelly'; known are {', '.join(MATERIALS)}"),
        ("linear", 0.0, 0.3, "Young's modulus must be positive"),
        ("linear", np.nan, 0.3, "Young's modulus must be positive"),
        ("linear", 1e4, 0.5, "Poisson's ratio must lie between.*0.5"),
        ("linear", 1e4, np.array([0.3, -1.2]), "it is -1.2"),
    ],
)
def test_impossible_parameters_are_refused(model, young, poisson, words):
    with pytest.raises(SoftprintError, match=words):
        make_material(model, young, poisson)
