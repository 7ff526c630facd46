"""The excess of a dent: strains against the response of all nodes, derivatives, and what is invariant of it."""

import numpy as np
import pytest

from softprint.runtime.body import assemble_body
from softprint.runtime.contact.learned_energy.dent_excess import DentExcess
from softprint.runtime.contact.learned_energy.dent_strain import CELLS, DentStrain, largest_cells
from softprint.runtime.elasticity.materials import make_material
from softprint.runtime.mechanics.body_mechanics import compute_mechanics
from softprint.runtime.mechanics.compliance.null_space_compliance import NullSpaceCompliance
from softprint.runtime.mechanics.loaded_points import LoadedPoints

FORCE = {2: 200.0, 3: 1.0}  # N: strains of some tenths


def made(body, model="stable_neo_hookean", at_most=400):
    """The strains of a body of a material, and points on its facets."""
    material = make_material(model, body.material.young, body.material.poisson)
    body = assemble_body(body.mesh, body.handles, material, 1000.0)
    compliance = compute_mechanics(body, at_most, condensation=False).surface_compliance
    return body, compliance, DentStrain.of(body, compliance), LoadedPoints.of_compliance(body, compliance, 1)


def pressed(loaded, body, rng, count=6):
    """Some neighbouring points on top, and forces on them, mostly downwards."""
    at = loaded.mean(body.mesh.points)
    order = np.argsort(np.square(at - [*[0.004, 0.002][: body.dim - 1], 0.06]).sum(axis=1))
    forces = 0.3 * FORCE[body.dim] * rng.normal(size=(count, body.dim))
    forces[:, -1] -= FORCE[body.dim]
    return np.sort(order[:count]), forces


@pytest.mark.parametrize("at_most", [400, 30], ids=["all nodes", "fewer contact nodes"])
def test_strains_are_those_of_the_response_of_all_nodes(jelly_body, at_most):
    """Of forces on contact nodes that are all near each other, in cells that have the node as a corner."""
    body, compliance, strain, _ = made(jelly_body, at_most=at_most)
    top = compliance.nodes[np.argmax(body.mesh.points[compliance.nodes, -1])]
    middle = int(np.flatnonzero(compliance.nodes == top)[0])
    near = strain.others[strain.starts[middle] : strain.starts[middle + 1]][:4]
    phi = np.random.default_rng(0).normal(size=(len(near), body.dim))
    cells, _ = largest_cells(body.mesh, compliance.nodes[near])
    assert (body.mesh.cells[cells] == compliance.nodes[near][:, None, None]).any(axis=2).all()
    u = compliance.apply(near, phi)
    expected = np.einsum("mcva,mcvb->mcab", u[body.mesh.cells[cells]], body.mesh.cell_gradients[cells])
    found = strain.among(near).strains(phi.reshape(-1, 1)).reshape(expected.shape)
    # Stored in single precision. A node far from another one feels nothing of it.
    known = [np.isin(near, strain.others[strain.starts[j] : strain.starts[j + 1]]).all() for j in near]
    assert any(known)
    np.testing.assert_allclose(found[known], expected[known], atol=1e-5 * np.abs(expected).max())


def test_strains_are_those_of_the_null_space_compliance(jelly_body):
    body, compliance, strain, _ = made(jelly_body)
    j = int(np.argmax(body.mesh.points[compliance.nodes, -1]))
    force = np.zeros((body.n_nodes, body.dim, 1))
    force[compliance.nodes[j], -1] = 1.0
    u = NullSpaceCompliance(body).solve(force)[..., 0]
    cells = largest_cells(body.mesh, compliance.nodes[[j]])[0][0]
    expected = np.einsum("cva,cvb->cab", u[body.mesh.cells[cells]], body.mesh.cell_gradients[cells])
    pushed = np.eye(body.dim)[:, -1:]
    found = strain.among(np.array([j])).strains(pushed).reshape(expected.shape)
    # The compliance is kept in single precision.
    np.testing.assert_allclose(found, expected, atol=1e-5 * np.abs(expected).max())


def test_cells_of_a_node_are_its_largest(jelly2d_body):
    """Each once: a node with fewer cells has one again, which does not count."""
    mesh = jelly2d_body.mesh
    cells, volumes = largest_cells(mesh, np.arange(mesh.n_nodes))
    assert cells.shape == volumes.shape == (mesh.n_nodes, CELLS)
    assert np.bincount(mesh.cells.ravel()).min() < CELLS
    for node in range(mesh.n_nodes):
        around = mesh.cell_volumes[(mesh.cells == node).any(axis=1)]
        expected = np.sort(np.r_[around, np.zeros(CELLS)])[::-1][:CELLS]
        np.testing.assert_array_equal(volumes[node], expected)
        assert (mesh.cells[cells[node]] == node).any(axis=1).all()


def test_derivatives_by_the_forces(jelly_body, dim):
    body, _, strain, loaded = made(jelly_body)
    rng = np.random.default_rng(1)
    active, forces = pressed(loaded, body, rng)
    forces *= 4.0
    here = DentExcess.of(strain, loaded, active, forces)
    assert here.value > 0.05  # beyond linear elasticity
    one, other = 4.0 * FORCE[dim] * rng.normal(size=(2, forces.size, 3))
    h = 1e-5
    for k in range(3):
        step = h * other[:, k].reshape(forces.shape)
        ahead, behind = (DentExcess.of(strain, loaded, active, forces + side * step) for side in (1, -1))
        # Central differences over 1e-5 of the forces: to the square of it.
        slope = (ahead.value - behind.value) / (2 * h)
        assert slope == pytest.approx(np.vdot(here.slope.ravel(), other[:, k]), rel=1e-6)
        bend = one.T @ (ahead.slope - behind.slope).ravel() / (2 * h)
        found = here.curvature(one, other)
        np.testing.assert_allclose(found[:, k], bend, atol=1e-6 * np.abs(bend).max())
    np.testing.assert_allclose(here.curvature(one, one), here.curvature(one, one.copy()), rtol=1e-9)


def test_excess_vanishes_with_the_forces_and_grows_like_them(jelly_body):
    """The first term beyond linear elasticity is of third order, so that the excess is of first."""
    body, _, strain, loaded = made(jelly_body)
    active, forces = pressed(loaded, body, np.random.default_rng(2))
    small, half = (DentExcess.of(strain, loaded, active, s * forces).value for s in (2e-2, 1e-2))
    # Terms of second order are some hundredths.
    assert half == pytest.approx(0.5 * small, rel=5e-2)
    assert DentExcess.of(strain, loaded, active, 1e-9 * forces).value == pytest.approx(0.0, abs=1e-6)


def test_excess_is_the_logarithm_of_a_ratio_of_energies(jelly_body, dim):
    """Where strains are large, the energy density of the solid is of power 2 dim in them, that of linear elasticity of
    power two."""
    body, _, strain, loaded = made(jelly_body)
    active, forces = pressed(loaded, body, np.random.default_rng(2))
    large, larger = (DentExcess.of(strain, loaded, active, s * forces).value for s in (1e5, 1e6))
    # Lower powers are less by the strains, some tens of thousands.
    assert larger - large == pytest.approx((2 * dim - 2) * np.log(10.0), rel=1e-2)


def test_a_linear_material_has_no_excess(jelly_body):
    body, _, strain, loaded = made(jelly_body, "linear")
    active, forces = pressed(loaded, body, np.random.default_rng(2))
    found = DentExcess.of(strain, loaded, active, forces)
    # Round-off of energies that cancel.
    assert abs(found.value) < 1e-12


def test_a_material_that_is_not_finite_if_inverted_has_a_finite_excess(jelly_body):
    body, _, strain, loaded = made(jelly_body, "neo_hookean")
    active, forces = pressed(loaded, body, np.random.default_rng(2))
    found = DentExcess.of(strain, loaded, active, 1e3 * forces)
    assert np.isfinite(found.value)
    assert np.isfinite(found.slope).all()


def test_a_force_on_another_point_joins_smoothly(jelly_body, dim):
    """A node that begins to bear has no say in the excess yet."""
    body, _, strain, loaded = made(jelly_body)
    active, forces = pressed(loaded, body, np.random.default_rng(3))
    first = DentExcess.of(strain, loaded, active[:-1], forces[:-1]).value
    forces[-1] *= 1e-6
    assert DentExcess.of(strain, loaded, active, forces).value == pytest.approx(first, rel=1e-4)
