"""The energies of a dent: strains against the response of all nodes, the energy density, derivatives, invariances."""

from dataclasses import replace

import numpy as np
import pytest

from softprint.runtime.body import assemble_body
from softprint.runtime.colliders.pose import rotation_matrix
from softprint.runtime.contact.dents.dent_energies import DentCells, DentChange
from softprint.runtime.contact.dents.dent_strain import CELLS, DentStrain, NearNodes, cells_of_layer
from softprint.runtime.contact.dents.prestrain import largest_cells
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
        return self.cells.energies(self.loaded, active, forces, rows, frame_rows)


def pressed(loaded, body, rng, count=6):
    """Some neighbouring points on top, and forces on them, mostly downwards."""
    at = loaded.mean(body.mesh.points)
    order = np.argsort(np.square(at - [*[0.004, 0.002][: body.dim - 1], 0.06]).sum(axis=1))
    forces = 0.3 * FORCE[body.dim] * rng.normal(size=(count, body.dim))
    forces[:, -1] -= FORCE[body.dim]
    return np.sort(order[:count]), forces


@pytest.mark.parametrize("at_most", [400, 30], ids=["all nodes", "fewer contact nodes"])
def test_strains_are_those_of_the_response_of_all_nodes(jelly_body, at_most):
    """Of forces on contact nodes that are all near each other."""
    body, compliance, strain, _ = made(jelly_body, at_most=at_most)
    top = compliance.nodes[np.argmax(body.mesh.points[compliance.nodes, -1])]
    middle = int(np.flatnonzero(compliance.nodes == top)[0])
    near = strain.near.others[strain.near.starts[middle] : strain.near.starts[middle + 1]][:4]
    phi = np.random.default_rng(0).normal(size=(len(near), body.dim))
    cells, _, counts = cells_of_layer(body.mesh, compliance.nodes, 1.5 * strain.spacing)
    cells, own = cells[near], (np.arange(CELLS) < counts[near, None])[..., None, None]
    u = compliance.apply(near, phi)
    expected = own * np.einsum("mcva,mcvb->mcab", u[body.mesh.cells[cells]], body.mesh.cell_gradients[cells])
    found = strain.between(near, near).strains(phi.reshape(-1, 1)).reshape(expected.shape)
    # Stored in single precision. A node far from another one feels nothing of it.
    known = [np.isin(near, strain.near.of(np.array([j]))[0]).all() for j in near]
    assert np.abs(expected[known]).max() > 0.0
    np.testing.assert_allclose(found[known], expected[known], atol=1e-5 * np.abs(expected).max())


def test_strains_are_those_of_the_null_space_compliance(jelly_body):
    body, compliance, strain, _ = made(jelly_body)
    j = int(np.argmax(body.mesh.points[compliance.nodes, -1]))
    force = np.zeros((body.n_nodes, body.dim, 1))
    force[compliance.nodes[j], -1] = 1.0
    u = NullSpaceCompliance(body).solve(force)[..., 0]
    around, _ = strain.around.of(np.array([j]))
    cells, _, counts = cells_of_layer(body.mesh, compliance.nodes, 1.5 * strain.spacing)
    cells, own = cells[around], (np.arange(CELLS) < counts[around, None])[..., None, None]
    expected = own * np.einsum("mcva,mcvb->mcab", u[body.mesh.cells[cells]], body.mesh.cell_gradients[cells])
    pushed = np.eye(body.dim)[:, -1:]
    found = strain.between(around, np.array([j])).strains(pushed).reshape(expected.shape)
    # The compliance is kept in single precision.
    np.testing.assert_allclose(found, expected, atol=1e-5 * np.abs(expected).max())


@pytest.mark.parametrize("every", [1, 9], ids=["all nodes", "every ninth"])
def test_cells_stand_for_the_layer_under_the_surface(jelly_body, every):
    """For the whole of its volume, each for cells that are near its node."""
    mesh, depth = jelly_body.mesh, 0.03
    # No cell is as near to two nodes.
    mesh = replace(mesh, points=mesh.points + 1e-4 * np.random.default_rng(0).random(mesh.points.shape))
    nodes = mesh.surface_nodes[::every]
    cells, volumes, counts = cells_of_layer(mesh, nodes, depth)
    centres = mesh.points[mesh.cells].mean(axis=1)
    distance = np.linalg.norm(centres[:, None] - mesh.points[nodes], axis=2)
    inside = distance.min(axis=1) <= depth
    owned = np.bincount(distance[inside].argmin(axis=1), minlength=len(nodes))
    np.testing.assert_array_equal(counts, np.minimum(owned, CELLS))
    assert every == 1 or owned.max() > CELLS  # some stand for several
    assert volumes.sum() == pytest.approx(mesh.cell_volumes[inside].sum(), rel=1e-12)
    own = np.arange(CELLS) < counts[:, None]
    np.testing.assert_array_equal(volumes > 0.0, own)
    chosen = cells[own]
    assert len(np.unique(chosen)) == len(chosen)
    np.testing.assert_array_equal(distance[chosen].argmin(axis=1), np.repeat(np.arange(len(nodes)), counts))
    alone = owned == counts
    np.testing.assert_allclose(volumes[alone][own[alone]], mesh.cell_volumes[cells[alone][own[alone]]], rtol=1e-12)


def test_cells_of_a_node_are_its_largest(jelly2d_body):
    """Each once: a node with fewer cells has one again, which does not count."""
    mesh = jelly2d_body.mesh
    cells, volumes = largest_cells(mesh, np.arange(mesh.n_nodes))
    most = cells.shape[1]
    assert np.bincount(mesh.cells.ravel()).min() < most
    for node in range(mesh.n_nodes):
        around = mesh.cell_volumes[(mesh.cells == node).any(axis=1)]
        np.testing.assert_array_equal(volumes[node], np.sort(np.r_[around, np.zeros(most)])[::-1][:most])
        assert (mesh.cells[cells[node]] == node).any(axis=1).all()


def test_nodes_near_others(dim):
    rest = np.random.default_rng(0).random((40, dim))
    nodes = np.array([3, 17, 18])
    found, near = NearNodes.within(0.3, rest).of(nodes)
    distance = np.linalg.norm(rest[:, None] - rest[nodes], axis=2)
    np.testing.assert_array_equal(found, np.flatnonzero((distance <= 0.3).any(axis=1)))
    np.testing.assert_array_equal(near, distance[found] <= 0.3)


@pytest.mark.parametrize("condensation", [True, False], ids=["settled", "subspace"])
def test_derivatives_by_the_forces_and_the_rows(jelly_body, dim, condensation):
    """In the frame of a step that starts elsewhere, where some nodes bear little."""
    dents, rng = Dents(jelly_body, condensation=condensation), np.random.default_rng(1)
    active, forces = pressed(dents.loaded, dents.body, rng)
    forces[:2] *= 0.02
    rows, frame_rows = dents.rows(), dents.rows(1)
    here = dents.at(active, forces, rows, frame_rows)
    n, h, share = 3, 1e-5, np.array([0.7, -1.3, 0.4, 2.1])
    of_forces = FORCE[dim] * rng.normal(size=(2, forces.size, n))
    of_rows = 0.01 * rng.normal(size=(2, rows.size, n))
    motions = here.prestrain.motions()
    bent = motions.bending(here.by_prestrain)
    one, other = (DentChange(f, motions.strain @ q) for f, q in zip(of_forces, of_rows, strict=True))
    found = here.curvature(share, one, other) + share[3] * of_rows[0].T @ bent @ of_rows[1]
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
        slope = (ahead.values - behind.values) / (2 * h)
        along = of_forces[1][:, k] @ here.slopes
        along[3] += np.vdot(here.prestrain.pulled_back(here.by_prestrain).ravel(), of_rows[1][:, k])
        np.testing.assert_allclose(slope, along, rtol=1e-5)
        of_slopes = of_forces[0].T @ (ahead.slopes - behind.slopes) @ share
        strains = (side.prestrain.pulled_back(side.by_prestrain) for side in (ahead, behind))
        of_strains = of_rows[0].T @ np.subtract(*strains).ravel()
        bend = (of_slopes + share[3] * of_strains) / (2 * h)
        np.testing.assert_allclose(found[:, k], bend, atol=1e-5 * np.abs(bend).max())
    # Without changes of the strain, and of one with itself.
    alone = DentChange(of_forces[0]), DentChange(of_forces[0].copy())
    np.testing.assert_allclose(
        here.curvature(share, alone[0], alone[0]), here.curvature(share, *alone), rtol=1e-9
    )
    np.testing.assert_allclose(here.curvature(share, one, one), here.curvature(share, one, _copied(one)), rtol=1e-9)


def _copied(change):
    return DentChange(change.forces.copy(), change.strain.copy())


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
    A = 0.5 * (np.swapaxes(F, 1, 2) @ F - np.eye(body.dim))
    E = A - A @ A / 2
    found = dents.cells.prestrain.at(np.arange(len(nodes)), rows, rows)
    # Modes in single precision. Bodies with one frame have one rotation.
    np.testing.assert_allclose(found.value, E.reshape(len(E), -1), atol=1e-6)
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
    there = cells.energies(dents.loaded, active, forces, turned, turned)
    # Gradients of rotations in single precision.
    np.testing.assert_allclose(there.values, here.values, rtol=1e-5)


def heavy(dents, times=1.0):
    """A contact in which all nodes count: W_2, W_3 and W_E are homogeneous in its forces."""
    active, forces = pressed(dents.loaded, dents.body, np.random.default_rng(2))
    return active, 1e3 * times * forces


def at_cells(dent):
    """Of the cells of a heavy contact: volumes, H (n, dim, dim), and E."""
    dim = dent.forces.shape[1]
    H = dent.strain.strains(dent.forces.reshape(-1, 1)).reshape(-1, dim, dim)
    return dent.volumes.ravel(), H, np.repeat(dent.prestrain.value, CELLS, axis=0).reshape(-1, dim, dim)


@pytest.mark.parametrize("model", ["stable_neo_hookean", "invertible_neo_hookean"])
def test_energies_are_the_terms_of_the_energy_density(jelly_body, model):
    """In powers of the displacement gradient: by differences of the energy of the cells, with the strain and without
    it."""
    dents = Dents(jelly_body, model, condensation=False)
    active, forces = heavy(dents)
    rest = dents.body.rest_rows
    # A small strain: W_E is its first two terms.
    dent = dents.at(active, forces, rest + 0.03 * (dents.rows() - rest))
    V, H, E = at_cells(dent)
    material = make_material(model, *(np.median(of) for of in (dents.body.material.young, dents.body.material.poisson)))
    identity = np.eye(dents.body.dim)
    a = 1e-2 / np.abs(H).max()

    def energies(at, a=a):
        """The parts of an energy density at F = at + a H that are even and odd in a H."""
        ahead, here, behind = (
            material.energy_and_stress(at + side * a * H)[0] for side in (1.0, 0.0, -1.0)
        )
        return (ahead - 2.0 * here + behind) / (2.0 * a**2), (ahead - behind) / (2.0 * a)

    rest = np.broadcast_to(identity, H.shape)
    (even, odd), (twice, _) = energies(rest), energies(rest, 2.0 * a)
    strained = energies(identity + E)[0] - even
    expected = V @ np.stack([even, odd / a**2, (twice - even) / (3.0 * a**2), strained], axis=1)
    # Terms of higher order: strains of a hundredth, and the third power of the strain of the body. Nodes at the edge
    # count by a thousandth less than one.
    np.testing.assert_allclose(dent.values, expected, rtol=5e-3)


def test_powers_of_the_forces(jelly_body):
    """W_2 and W_E are of the second power, W_3 and W_4 of the third and fourth; from light nodes all have two more."""
    dents = Dents(jelly_body)
    here, twice = (dents.at(*heavy(dents, times), dents.rows()).values for times in (1.0, 2.0))
    # How much nodes count: by less than a hundred thousandth more.
    np.testing.assert_allclose(twice, [4.0, 8.0, 16.0, 4.0] * here, rtol=1e-4)
    light, lighter = (dents.at(*heavy(dents, times), dents.rows()).values for times in (2e-9, 1e-9))
    np.testing.assert_allclose(light, [16.0, 32.0, 64.0, 16.0] * lighter, rtol=1e-4)
    nothing = dents.at(*heavy(dents, 0.0), dents.rows())
    np.testing.assert_array_equal(nothing.values, 0.0)
    np.testing.assert_array_equal(nothing.slopes, 0.0)


def test_a_body_without_strain_is_not_stiffened(jelly_body, dim):
    """However it is turned; one that is strained is."""
    dents = Dents(jelly_body, condensation=False)
    contact = heavy(dents)
    Q = rotation_matrix([0.7] if dim == 2 else [0.2, -0.4, 1.1], dim)
    turned, strained = (dents.at(*contact, rows).values for rows in (dents.body.rest_rows @ Q.T, dents.rows()))
    # Modes in single precision.
    assert abs(turned[3]) < 1e-5 * turned[0]
    assert abs(strained[3]) > 5e-3 * strained[0]


def test_dents_that_lie_apart_add_up(jelly_body):
    """Each as if it were alone, but for the strain that is felt as far as four distances between nodes, of 20 mm."""
    dents = Dents(jelly_body)
    at = dents.loaded.mean(dents.body.mesh.points)
    top = np.flatnonzero(at[:, -1] > 0.0599)
    left, right = (top[np.argsort(side * at[top, 0])[:2]] for side in (1.0, -1.0))
    active = np.sort(np.r_[left, right])
    forces = np.tile(-FORCE[dents.body.dim] * np.eye(dents.body.dim)[-1], (4, 1))
    both = dents.at(active, forces, dents.rows()).values
    alone = [dents.at(np.sort(own), forces[:2], dents.rows()).values for own in (left, right)]
    np.testing.assert_allclose(both[:3], sum(alone)[:3], rtol=0.1)
    assert both[3] == pytest.approx(sum(alone)[3], abs=2e-3 * both[0])


def test_a_linear_material_has_that_of_linear_mechanics(jelly_body):
    dents = Dents(jelly_body, "linear")
    W_2, W_3, W_4, W_E = dents.at(*heavy(dents), dents.rows()).values
    strain = np.abs(at_cells(dents.at(*heavy(dents), dents.rows()))[1]).max()
    # Round-off of differences of tangents.
    assert abs(W_3) < 1e-8 * strain * W_2
    assert abs(W_4) < 1e-6 * strain**2 * W_2
    assert abs(W_E) < 1e-8 * W_2


def test_a_force_on_another_point_joins_smoothly(jelly_body, dim):
    """A node that begins to bear has no say in the energies yet."""
    dents = Dents(jelly_body)
    active, forces = pressed(dents.loaded, dents.body, np.random.default_rng(3))
    first = dents.at(active[:-1], forces[:-1], dents.rows())
    forces[-1] *= 1e-6
    then = dents.at(active, forces, dents.rows())
    np.testing.assert_allclose(then.values, first.values, rtol=1e-4)
