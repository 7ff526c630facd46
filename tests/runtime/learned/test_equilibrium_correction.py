"""Modes in elastic equilibrium: their derivatives and energy against finite differences, invariance, the equilibrium of
full space, and what is said where there is none."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from scipy.linalg import null_space

from softprint.runtime.arrays import Array
from softprint.runtime.body import ReducedBody, assemble_body, frame_in_box, place_handles
from softprint.runtime.body.cubature import Cubature, elastic_cells
from softprint.runtime.contact import PenaltyContact
from softprint.runtime.dynamics import KinematicHandle, Simulator
from softprint.runtime.dynamics.corrected_points import CorrectedPoints
from softprint.runtime.dynamics.terms.elastic import ElasticEnergy
from softprint.runtime.dynamics.timings import Timings
from softprint.runtime.elasticity.elastic_energy import elastic_gradient
from softprint.runtime.elasticity.materials import make_material
from softprint.runtime.errors import SoftprintError
from softprint.runtime.learned.internal.equilibrium import elastic_amplitudes
from softprint.runtime.learned.internal.equilibrium.correction import EquilibriumCorrection, ModesPoint
from softprint.runtime.learned.internal.file import with_cubature
from softprint.runtime.mesh import box_mesh
from softprint.runtime.optimise import Status
from tests.internal_model import made_modes
from tests.runtime.learned.test_internal_correction import bent, close, differences, moved, rotation

# Jacobians and Hessians are in single precision.
SINGLE = 2e-5


def nearly(found: Array, expected: Array, share: float = SINGLE) -> None:
    np.testing.assert_allclose(found, expected, atol=share * np.abs(expected).max())


@pytest.fixture
def gravity(dim: int) -> tuple[float, ...]:
    return tuple(np.linspace(2.0, -9.0, dim))


def test_amplitudes_know_their_derivative(jelly_body, gravity):
    """By the implicit function theorem, along directions and pulled back; u with them, at some of the nodes."""
    correction, rows = EquilibriumCorrection(made_modes(jelly_body, gravity), jelly_body), bent(jelly_body)
    point = correction.amplitudes.at(rows)
    assert point.converged
    assert np.abs(point.a).max() > 1e-3
    slope = differences(lambda at: correction.amplitudes.at(at).a, rows).reshape(len(point.a), -1)
    nearly(point.along(None), slope)
    rng = np.random.default_rng(1)
    b, directions = rng.normal(size=len(point.a)), rng.normal(size=(rows.size, 3))
    close(point.pulled_back(b).ravel(), b @ slope)
    nearly(point.along(directions), slope @ directions)
    bound = correction.bind().at(np.arange(3, jelly_body.n_nodes, 2))
    field, expected = bound.linearise(rows), differences(bound.displacement, rows)
    nearly(field.jacobian, expected)
    forces = rng.normal(size=field.displacement.shape)
    close(field.pulled_back(forces), np.tensordot(forces, expected, axes=2))


def test_amplitudes_know_how_their_derivative_changes(jelly_body, gravity):
    """The second derivatives of b . a, and of the work of forces along u at some of the nodes."""
    correction, rows = EquilibriumCorrection(made_modes(jelly_body, gravity), jelly_body), bent(jelly_body)
    point, rng = correction.amplitudes.at(rows), np.random.default_rng(4)
    b, directions = rng.normal(size=len(point.a)), rng.normal(size=(rows.size, 3))
    slopes = differences(lambda at: correction.amplitudes.at(at).pulled_back(b).ravel(), rows)
    expected = slopes.reshape(rows.size, rows.size)
    nearly(point.curvature(b, None), expected)
    nearly(point.curvature(b, directions), directions.T @ expected @ directions)
    nearly(point.curvature(2.0 * b, directions), 2.0 * directions.T @ expected @ directions)
    bound = correction.bind().at(np.arange(3, jelly_body.n_nodes, 2))
    forces = rng.normal(size=bound.displacement(rows).shape)
    slopes = differences(lambda at: bound.linearise(at).pulled_back(forces).ravel(), rows)
    nearly(bound.linearise(rows).curvature(forces, None), slopes.reshape(rows.size, rows.size))


def test_the_elastic_energy_has_the_gradient_and_hessian_of_its_equilibrium(jelly_body):
    """With the amplitudes where the energy is least on the same cubature."""
    correction, rows = EquilibriumCorrection(made_modes(jelly_body), jelly_body), bent(jelly_body)
    points = CorrectedPoints(jelly_body, [], internal=correction)
    term, phase = ElasticEnergy(jelly_body, points), Timings().correction

    def evaluated(at: Array):
        field = points.linearise(at, {}, phase)
        return term.evaluate(at, points.scatter(field)), field

    elastic, field = evaluated(rows)
    assert elastic.energy < 0.99 * term.evaluate(rows, np.zeros_like(field.displacement)).energy
    assert elastic.energy == pytest.approx(correction.amplitudes.at(rows).strained.elastic, rel=1e-12)
    gradient, hessian = elastic.linearise(field)
    close(gradient, differences(lambda at: np.float64(evaluated(at)[0].energy), rows))

    def slope(at: Array) -> Array:
        own, by = evaluated(at)
        return own.linearise(by)[0].ravel()

    expected = differences(slope, rows).reshape(rows.size, rows.size)
    nearly(hessian(None), expected)
    directions = np.random.default_rng(2).normal(size=(rows.size, 4))
    nearly(hessian(directions), directions.T @ expected @ directions)


def test_weight_and_elasticity_together_are_stationary(jelly_body, gravity):
    """The energy of both by the rows."""
    correction, rows = EquilibriumCorrection(made_modes(jelly_body, gravity), jelly_body), bent(jelly_body)
    assert correction.gravity == gravity
    points = CorrectedPoints(jelly_body, [], internal=correction)
    term, phase = ElasticEnergy(jelly_body, points), Timings().correction
    weight = correction.weight(jelly_body.node_mass, np.array(gravity))

    def slope(at: Array) -> Array:
        field = points.linearise(at, {}, phase)
        return term.evaluate(at, points.scatter(field)).linearise(field)[0] + weight.at(at).gradient

    def energy(at: Array) -> np.float64:
        elastic = term.evaluate(at, points.displacement(at, {}, phase)).energy
        return np.float64(elastic + weight.at(at).energy)

    close(slope(rows), differences(energy, rows))
    field = points.linearise(rows, {}, phase)
    own = term.evaluate(rows, points.scatter(field)).linearise(field)[1]
    expected = differences(lambda at: slope(at).ravel(), rows).reshape(rows.size, rows.size)
    nearly(own(None) + weight.at(rows).hessian(), expected)
    # The weight by each node.
    heights = correction.bind().displacement(rows) @ np.array(gravity)
    assert weight.at(rows).energy == pytest.approx(-float(jelly_body.node_mass @ heights), rel=1e-12)


def test_a_moved_and_turned_body_has_the_same_correction(jelly_body, dim):
    correction, rows = EquilibriumCorrection(made_modes(jelly_body), jelly_body), bent(jelly_body)
    bound = correction.bind()
    before = bound.displacement(rows)
    again = moved(jelly_body, rows, -1.1, np.full(dim, 2.0))
    nearly(bound.displacement(again), before @ rotation(dim, -1.1).T, 1e-8)
    np.testing.assert_allclose(bound.displacement(jelly_body.rest_rows), 0.0, atol=1e-12)


def test_the_reduced_state_is_that_of_the_rows(jelly_body):
    """What the modes would move the points by is taken back."""
    correction, rows = EquilibriumCorrection(made_modes(jelly_body), jelly_body), bent(jelly_body)
    x = jelly_body.reduced_positions(rows) + correction.bind().displacement(rows)
    np.testing.assert_allclose(jelly_body.project(x), rows, atol=1e-10)


def test_the_result_does_not_depend_on_the_start(jelly_body):
    """Neither on the state before nor on the estimate of the file."""
    model, rows = made_modes(jelly_body), bent(jelly_body)
    near, far = EquilibriumCorrection(model, jelly_body), EquilibriumCorrection(model, jelly_body)
    near.amplitudes.at(rows + 1e-5)
    model.offset += 0.3
    other = EquilibriumCorrection(model, jelly_body)
    expected = far.amplitudes.at(rows).a
    assert near.amplitudes.at(rows).iterations <= far.amplitudes.at(rows).iterations
    for correction in (near, other):
        assert correction.amplitudes.at(rows).converged
        nearly(correction.amplitudes.at(rows).a, expected, 1e-8)


def tiny(dim: int, n_points: int = 1) -> ReducedBody:
    """A bar of a few cells between two frames with points, integrated over all of them."""
    size, counts = ([0.06, 0.02], [6, 2]) if dim == 2 else ([0.06, 0.02, 0.02], [6, 1, 1])
    mesh, wide = box_mesh([0.0] * dim, size, counts), [1.0] * (dim - 1)
    ends = [
        frame_in_box(mesh, "left", [[-1.0] * dim, [0.0101, *wide]]),
        frame_in_box(mesh, "right", [[0.0499, *(-1.0 for _ in wide)], [1.0] * dim]),
    ]
    body = assemble_body(
        mesh, place_handles(mesh, n_points, ends), make_material("stable_neo_hookean", 2e4, 0.4), 1e3
    )
    cells = elastic_cells(mesh, body.handles)
    return with_cubature(body, Cubature(cells, mesh.cell_volumes[cells], 0.0, 0.0))


@pytest.mark.parametrize("n_points", [0, 1])
@pytest.mark.parametrize("dim", [2, 3])
def test_all_modes_give_the_equilibrium_of_full_space(dim, n_points):
    """With all cells: nodes outside frames have no forces but those that hold the points, to round-off."""
    body = tiny(dim, n_points)
    free = np.setdiff1d(np.arange(body.n_nodes), body.handles.frame_nodes)
    held = body.constraint_basis[free]
    every = np.kron(null_space(held.T) if n_points else np.eye(len(free)), np.eye(dim)).T
    modes = np.zeros((len(every), body.n_nodes, dim))
    modes[:, free] = every.reshape(len(every), -1, dim)
    correction, rows = EquilibriumCorrection(made_modes(body, (), modes), body), bent(body)
    point = correction.amplitudes.at(rows)
    assert point.converged
    x = body.reduced_positions(rows) + correction.bind().displacement(rows)

    def unbalanced(at: Array) -> float:
        force = elastic_gradient(body.mesh, body.material, at)[free]
        return float(np.linalg.norm(force - held @ np.linalg.lstsq(held, force, rcond=None)[0]))

    # Amplitudes are right to 1e-10 in the norm of the energy, in which forces of short waves weigh less.
    assert unbalanced(x) < 1e-7 * unbalanced(body.reduced_positions(rows))
    np.testing.assert_allclose(body.project(x), rows, atol=1e-10)


@pytest.mark.parametrize("dim", [2])
def test_steps_converge_and_say_where_modes_do_not(dim, monkeypatch):
    body = tiny(dim)
    correction = EquilibriumCorrection(made_modes(body), body)
    held = [KinematicHandle("left")]
    simulator = Simulator(
        body, contact=PenaltyContact(1e9), internal=correction, gravity=[0.0, -2.0], kinematic=held
    )
    result = simulator.step(simulator.rest_state())
    assert result.converged, result.reason
    assert result.iterations < 10
    monkeypatch.setattr(elastic_amplitudes, "_ITERATIONS", 1)
    assert not EquilibriumCorrection(made_modes(body), body).amplitudes.at(bent(body)).converged
    monkeypatch.undo()
    monkeypatch.setattr(ModesPoint, "converged", False)
    failed = simulator.step(simulator.rest_state())
    assert failed.status is Status.CORRECTION_UNSOLVED
    assert "amplitudes" in failed.status.sentence


def test_another_body_is_refused(jelly_body):
    model = made_modes(jelly_body)
    model.modes = torch.zeros(2, jelly_body.n_nodes + 1, jelly_body.dim)
    with pytest.raises(SoftprintError, match="train it for this body"):
        EquilibriumCorrection(model, jelly_body)
