"""The measures of a dent: strains against the response of all nodes, derivatives, and what is invariant of them."""

from dataclasses import replace

import numpy as np
import pytest

from softprint.runtime.body import assemble_body
from softprint.runtime.body.rotations import nearest_rotations
from softprint.runtime.colliders.pose import rotation_matrix
from softprint.runtime.contact.dents.dent_measures import DentCells, DentChange
from softprint.runtime.contact.dents.dent_strain import CELLS, DentStrain, largest_cells
from softprint.runtime.elasticity.materials import make_material
from softprint.runtime.elasticity.strained_stiffness import strain_components
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


class Dents:
    """Dents in a body of a material; it is settled in static condensation under its weight, or is its subspace."""

    def __init__(self, body, model="stable_neo_hookean", condensation=True):
        material = make_material(model, body.material.young, body.material.poisson)
        self.body = assemble_body(body.mesh, body.handles, material, 1000.0)
        gravity = -9.81 * np.eye(body.dim)[-1]
        self.mechanics = compute_mechanics(self.body, 400, condensation=condensation, gravity=gravity)
        self.cells = DentCells.of(self.body, self.mechanics)
        self.loaded = LoadedPoints.of_compliance(self.body, self.mechanics.surface_compliance, 1)

    def rows(self, seed=0, size=0.003):
        """The handles displaced at random [m]: some tenths of strain."""
        rows, count = self.body.rest_rows.copy(), self.body.handles.n_points
        rows[:count] += size * np.random.default_rng(seed).normal(size=(count, self.body.dim))
        return rows

    def at(self, active, forces, rows=None, frame_rows=None):
        rows = self.body.rest_rows if rows is None else rows
        frame_rows = rows if frame_rows is None else frame_rows
        return self.cells.measures(self.loaded, active, forces, rows, frame_rows)


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


@pytest.mark.parametrize("condensation", [True, False], ids=["settled", "subspace"])
def test_derivatives_by_the_forces_and_the_rows(jelly_body, dim, condensation):
    """In the frame of a step that starts elsewhere."""
    dents, rng = Dents(jelly_body, condensation=condensation), np.random.default_rng(1)
    active, forces = pressed(dents.loaded, dents.body, rng)
    forces *= 4.0
    rows, frame_rows = dents.rows(), dents.rows(1)
    here = dents.at(active, forces, rows, frame_rows)
    assert here.excess > 0.05  # beyond linear elasticity
    assert abs(here.stiffening) > 1e-3
    n, h, counted = 3, 1e-5, np.array([0.7, -1.3])
    of_forces = 4.0 * FORCE[dim] * rng.normal(size=(2, forces.size, n))
    of_rows = 0.01 * rng.normal(size=(2, rows.size, n))
    motions = here.prestrain.motions()
    bent = motions.bending(here.by_prestrain)
    one, other = (DentChange(f, motions.strain @ q) for f, q in zip(of_forces, of_rows, strict=True))
    found = here.curvature(counted, one, other) + counted[0] * of_rows[0].T @ bent @ of_rows[1]
    for k in range(n):
        force, row = (h * way[1][:, k] for way in (of_forces, of_rows))
        ahead, behind = (
            dents.at(
                active,
                forces + side * force.reshape(forces.shape),
                rows + side * row.reshape(rows.shape),
                frame_rows,
            )
            for side in (1, -1)
        )
        # Central differences over 1e-5 of forces and strains: to the square of it.
        slope = np.array([ahead.stiffening - behind.stiffening, ahead.excess - behind.excess]) / (2 * h)
        along = of_forces[1][:, k] @ here.slopes
        along[0] += np.vdot(here.prestrain.pulled_back(here.by_prestrain).ravel(), of_rows[1][:, k])
        np.testing.assert_allclose(slope, along, rtol=1e-5)
        of_slopes = of_forces[0].T @ (ahead.slopes - behind.slopes) @ counted
        strains = (side.prestrain.pulled_back(side.by_prestrain) for side in (ahead, behind))
        of_strains = of_rows[0].T @ np.subtract(*strains).ravel()
        bend = (of_slopes + counted[0] * of_strains) / (2 * h)
        np.testing.assert_allclose(found[:, k], bend, atol=1e-5 * np.abs(bend).max())
    # Without changes of the strain, and of one with itself.
    alone = DentChange(of_forces[0]), DentChange(of_forces[0].copy())
    np.testing.assert_allclose(
        here.curvature(counted, alone[0], alone[0]), here.curvature(counted, *alone), rtol=1e-9
    )


def test_changes_of_the_rows_are_those_along_directions(jelly_body):
    dents, rng = Dents(jelly_body), np.random.default_rng(1)
    here = dents.at(*pressed(dents.loaded, dents.body, rng), dents.rows())
    along = rng.normal(size=(dents.body.rest_rows.size, 2))
    M = rng.normal(size=here.prestrain.value.shape)
    every, some = here.prestrain.motions(), here.prestrain.motions(along)
    # Round-off of sums in another order.
    np.testing.assert_allclose(some.strain, every.strain @ along, atol=1e-9)
    np.testing.assert_allclose(some.bending(M), along.T @ every.bending(M) @ along, rtol=1e-9)
    pulled = np.einsum("msr,ms->r", every.strain, M)
    found = here.prestrain.pulled_back(M).ravel()
    np.testing.assert_allclose(found, pulled, atol=1e-9 * np.abs(pulled).max())


@pytest.mark.parametrize("condensation", [True, False], ids=["settled", "subspace"])
def test_prestrain_is_that_of_the_positions_without_contact(jelly_body, condensation):
    """Of the deformation gradient, a mean over the cells of each node."""
    dents = Dents(jelly_body, condensation=condensation)
    body, rows, nodes = dents.body, dents.rows(), dents.mechanics.surface_compliance.nodes
    positions = body.reduced_positions(rows)
    if condensation:
        positions = positions + dents.mechanics.condensation.corotated(rows).displacement(rows)
    cells, volumes = largest_cells(body.mesh, nodes)
    of_cells = body.mesh.deformation_gradients(positions, cells.ravel()).reshape(
        *cells.shape, body.dim, body.dim
    )
    F = np.einsum("nc,ncab->nab", volumes / volumes.sum(axis=1, keepdims=True), of_cells)
    E = 0.5 * (np.swapaxes(F, 1, 2) @ F - np.eye(body.dim))
    found = dents.cells.prestrain.at(np.arange(len(nodes)), rows, rows)
    # Modes in single precision. Bodies with one frame have one rotation.
    np.testing.assert_allclose(found.value, E[:, *strain_components(body.dim)], atol=1e-6)
    assert np.abs(E).max() > 0.1


def test_rotating_the_body_with_its_frame_changes_nothing(jelly_body, dim):
    """Its weight rotates with it."""
    dents = Dents(jelly_body)
    active, forces = pressed(dents.loaded, dents.body, np.random.default_rng(2))
    Q = rotation_matrix([0.7] if dim == 2 else [0.2, -0.4, 1.1], dim)
    affine, rows = dents.body.handles.affine_part, dents.rows()
    turned = rows @ Q.T + np.outer(affine, np.full(dim, 3.0))
    prestrain = dents.cells.prestrain
    cells = dents.cells._replace(prestrain=replace(prestrain, gravity=Q @ prestrain.gravity))
    here = dents.at(active, forces, rows)
    there = cells.measures(dents.loaded, active, forces, turned, turned)
    # Gradients of rotations in single precision.
    assert there.stiffening == pytest.approx(here.stiffening, rel=1e-5)
    assert there.excess == pytest.approx(here.excess, rel=1e-12)


def test_a_body_without_strain_does_not_stiffen(jelly_body, dim):
    """However it is turned; one that is strained does."""
    dents = Dents(jelly_body, condensation=False)
    active, forces = pressed(dents.loaded, dents.body, np.random.default_rng(2))
    Q = rotation_matrix([0.7] if dim == 2 else [0.2, -0.4, 1.1], dim)
    # Modes in single precision.
    assert dents.at(active, forces, dents.body.rest_rows @ Q.T).stiffening == pytest.approx(0.0, abs=1e-5)
    assert abs(dents.at(active, forces, dents.rows()).stiffening) > 5e-3


def test_stiffening_is_what_the_strained_tangent_says(jelly_body, dim):
    """To first order in the strain of the nodes."""
    dents = Dents(jelly_body, condensation=False)
    active, forces = pressed(dents.loaded, dents.body, np.random.default_rng(2))
    rest, moved = dents.body.rest_rows, dents.rows()

    def both(share):
        found = dents.at(active, forces, rest + share * (moved - rest))
        F = np.repeat(found.prestrain.F, CELLS, axis=0)
        U = np.swapaxes(nearest_rotations(F), 1, 2) @ F
        H = found.strain.strains(found.forces.reshape(-1, 1)).reshape(len(U), -1)
        strained, at_rest = (
            np.einsum("na,nab,nb->n", H, found.materials.material.tangent(at).reshape(len(H), dim**2, -1), H)
            for at in (U, np.broadcast_to(np.eye(dim), U.shape).copy())
        )
        weight = (np.square(found.forces).sum(axis=1)[:, None] * found.volumes).ravel()
        return np.array([found.stiffening, weight @ np.log(strained / at_rest) / weight.sum()])

    # The difference of both signs has no terms of second order: strains of some thousandths.
    found, expected = both(0.02) - both(-0.02)
    assert found == pytest.approx(expected, rel=2e-3)
    assert abs(found) > 1e-4


@pytest.mark.parametrize("size", [0.1, -3.0])
def test_absurd_strains_stay_within_the_bound(jelly_body, size):
    dents = Dents(jelly_body, condensation=False)
    active, forces = pressed(dents.loaded, dents.body, np.random.default_rng(2))
    found = dents.at(active, forces, dents.rows(size=size))
    assert abs(found.stiffening) <= 1.0
    assert np.isfinite(found.slopes).all()
    assert np.isfinite(found.by_prestrain).all()


def test_excess_vanishes_with_the_forces_and_grows_like_them(jelly_body):
    """The first term beyond linear elasticity is of third order, so that the excess is of first."""
    dents = Dents(jelly_body)
    active, forces = pressed(dents.loaded, dents.body, np.random.default_rng(2))
    small, half = (dents.at(active, s * forces).excess for s in (2e-2, 1e-2))
    # Terms of second order are some hundredths.
    assert half == pytest.approx(0.5 * small, rel=5e-2)
    assert dents.at(active, 1e-9 * forces).excess == pytest.approx(0.0, abs=1e-6)


def test_excess_is_the_logarithm_of_a_ratio_of_energies(jelly_body, dim):
    """Where strains are large, the energy density of the solid is of power 2 dim in them, that of linear elasticity of
    power two."""
    dents = Dents(jelly_body)
    active, forces = pressed(dents.loaded, dents.body, np.random.default_rng(2))
    large, larger = (dents.at(active, s * forces).excess for s in (1e5, 1e6))
    # Lower powers are less by the strains, some tens of thousands.
    assert larger - large == pytest.approx((2 * dim - 2) * np.log(10.0), rel=1e-2)


def test_a_linear_material_has_neither(jelly_body):
    dents = Dents(jelly_body, "linear")
    active, forces = pressed(dents.loaded, dents.body, np.random.default_rng(2))
    found = dents.at(active, forces, dents.rows())
    # Round-off of energies that cancel, and of differences of tangents.
    assert abs(found.excess) < 1e-12
    assert abs(found.stiffening) < 1e-8


def test_a_material_that_is_not_finite_if_inverted_has_finite_measures(jelly_body):
    dents = Dents(jelly_body, "neo_hookean")
    active, forces = pressed(dents.loaded, dents.body, np.random.default_rng(2))
    found = dents.at(active, 1e3 * forces, dents.rows())
    assert np.isfinite([found.excess, found.stiffening]).all()
    assert np.isfinite(found.slopes).all()


def test_a_force_on_another_point_joins_smoothly(jelly_body, dim):
    """A node that begins to bear has no say in the measures yet."""
    dents = Dents(jelly_body)
    active, forces = pressed(dents.loaded, dents.body, np.random.default_rng(3))
    first = dents.at(active[:-1], forces[:-1], dents.rows())
    forces[-1] *= 1e-6
    then = dents.at(active, forces, dents.rows())
    assert then.excess == pytest.approx(first.excess, rel=1e-4)
    assert then.stiffening == pytest.approx(first.stiffening, rel=1e-4)
