"""Internal corrections from a truth of states: targets, principal components, training, and their files."""

from __future__ import annotations

import numpy as np
import pytest
import torch

pytest.importorskip("dolfinx")

from softprint.fem_truth.elasticity.full_space_elasticity import FullSpaceElasticity
from softprint.fem_truth.sampling.recorded_states import disturbed_states
from softprint.fem_truth.statics.constrained import ConstrainedProblem
from softprint.runtime.arrays import Array
from softprint.runtime.body import ReducedBody, assemble_body, place_handles
from softprint.runtime.body.cubature import dof_scale
from softprint.runtime.body.node_gradients import basis_gradient_at_nodes
from softprint.runtime.contact import PenaltyContact
from softprint.runtime.elasticity.elastic_energy import elastic_energy, elastic_gradient
from softprint.runtime.elasticity.materials import make_material
from softprint.runtime.errors import SoftprintError
from softprint.runtime.learned.internal.correction import InternalCorrection, mapped, unmapped
from softprint.runtime.learned.internal.file import load_internal, save_internal
from softprint.runtime.mesh import box_mesh
from softprint.runtime.truth.truth_file import load_truth
from softprint.surrogate.data.components import principal_components
from softprint.surrogate.internal.cubature import fitted_cubature, force_system
from softprint.surrogate.internal.data import read_internal_data
from softprint.surrogate.internal.entry import train_internal
from softprint.surrogate.internal.norm import CorrectionNorm
from softprint.surrogate.internal.slopes import EquilibriumSlopes
from softprint.surrogate.train import TrainingSettings
from tests.internal_truth import DISTURBED, FRAMES, written_truth

SETTINGS = TrainingSettings(steps=400, batch=32, learning_rate=3e-3, weight_decay=1e-4, validations=4, seed=0)


def test_disturbed_states_follow_their_own(body):
    rows = np.array([body.rest_rows, 2.0 * body.rest_rows])
    found = disturbed_states(body, rows, 3, 0.01, np.random.default_rng(0))
    assert found.shape == (8, *body.rest_rows.shape)
    np.testing.assert_array_equal(found[[0, 4]], rows)
    moved = np.linalg.norm(found[1:4, :3] - body.rest_rows[:3], axis=2)
    assert 0.1 < moved.mean() / (0.01 * body.mesh.size) < 2.0  # of a normal distribution
    body.handles.check_rows(found[1])  # frames are rigid


@pytest.mark.parametrize("condensed", [False, True])
def test_exact_targets_give_the_full_space_equilibrium(body, condensation, truth_path, condensed):
    """To round-off of the mapping and its inverse."""
    gradient = basis_gradient_at_nodes(body)
    with load_truth(truth_path, body) as truth:
        data = read_internal_data(truth, body, condensation if condensed else None)
        assert len(data.fields) == len(truth.states) == FRAMES * (1 + DISTURBED)
        for state in (0, 7, len(truth.states) - 1):
            rows = truth.states["rows"][state]
            x = body.reduced_positions(rows) + mapped(gradient, rows, data.fields[state])
            if condensed:
                x += condensation.corotated(rows).displacement(rows)
            np.testing.assert_allclose(x, body.reduced_positions(rows) + truth.internal(state), atol=1e-15)
    # A recorded state and its disturbed ones are held out together, and nothing is on both sides.
    assert not set(data.train) & set(data.held_out)
    assert len(set(data.held_out // (1 + DISTURBED))) * (1 + DISTURBED) == len(data.held_out) > 0


@pytest.mark.parametrize("condensed", [False, True])
def test_slopes_are_differences_of_equilibria(body, condensation, truth_path, condensed):
    """Of the correction at equilibria a small step away, to the error of central differences."""
    gradient, own = basis_gradient_at_nodes(body), condensation if condensed else None
    problem = ConstrainedProblem(FullSpaceElasticity(body), np.zeros(2), PenaltyContact(1e9), body)
    slopes, rng = EquilibriumSlopes(body, own), np.random.default_rng(6)

    def correction(rows: Array) -> tuple[Array, Array]:
        solved = problem.internal_equilibrium(rows)
        assert solved.converged
        u = internal = solved.x - body.reduced_positions(rows)
        if own is not None:
            u = u - own.corotated(rows).displacement(rows)
        return internal, unmapped(gradient, rows, u)

    with load_truth(truth_path, body) as truth:
        rows = truth.states["rows"][37]
    internal, r = correction(rows)
    direction, step = rng.normal(size=body.handles.n_dofs), 1e-3
    change = step * (slopes.tangent(rows) @ direction).reshape(rows.shape)
    expected = (correction(rows + change)[1] - correction(rows - change)[1]) / (2.0 * step)
    found = slopes.at(rows, internal, r) @ direction
    np.testing.assert_allclose(found, expected, atol=1e-3 * np.abs(expected).max())


def test_derivatives_help_a_correction_learn(body, truth_path):
    """From the same states, in the same steps of training."""
    with load_truth(truth_path, body) as truth:
        with_them, without = (
            train_internal(truth, body, None, (16, 16), 10, settings=SETTINGS, derivatives=derivatives)
            for derivatives in (True, False)
        )
    assert with_them.held_out.rms < without.held_out.rms


def test_the_norm_is_energy_and_volume_in_equal_parts(body):
    rng = np.random.default_rng(8)
    fields = rng.normal(size=(12, body.n_nodes, 2))
    norm = CorrectionNorm(body, fields)
    assert norm.squares(fields).mean() == pytest.approx(1.0, rel=1e-10)
    modes, beyond = norm.components(fields, 12)
    assert beyond == pytest.approx(0.0, abs=1e-12)
    coefficients = fields.reshape(12, -1) @ norm.dual(modes).T
    np.testing.assert_allclose(np.tensordot(coefficients, modes, axes=1), fields, atol=1e-8)
    with pytest.raises(SoftprintError, match="have 12"):
        norm.components(fields, 13)
    with pytest.raises(SoftprintError, match="nothing to learn"):
        CorrectionNorm(body, np.zeros_like(fields))


def energy(fields: Array, volumes: Array) -> float:
    return float(np.einsum("snd,n->", fields**2, volumes))


@pytest.mark.parametrize("nodes", [50, 10])
def test_the_truncation_error_of_components_is_the_discarded_energy(nodes):
    """With fewer fields than values in one, and with more."""
    rng = np.random.default_rng(4)
    fields = np.einsum(
        "sk,knd->snd", rng.normal(size=(30, 8)) * 0.5 ** np.arange(8), rng.normal(size=(8, nodes, 2))
    )
    volumes = rng.uniform(0.5, 2.0, nodes)
    for count in (3, 8):
        found = principal_components(fields, volumes, count)
        gram = np.einsum("knd,lnd,n->kl", found.modes, found.modes, volumes)
        np.testing.assert_allclose(gram, np.eye(count), atol=1e-10)
        left = fields - np.einsum("sk,knd->snd", found.coefficients, found.modes)
        # Of 8 components, the rest is round-off of the squares.
        expected = energy(left, volumes) / energy(fields, volumes)
        assert found.discarded == pytest.approx(expected, rel=1e-8, abs=1e-14)
    with pytest.raises(SoftprintError, match="have 8"):
        principal_components(fields, volumes, 9)


@pytest.mark.parametrize("condensed", [False, True])
def test_a_trained_correction_brings_the_body_nearer_to_full_space(
    body, condensation, truth_path, condensed, tmp_path
):
    """Better than nothing on states that were held out, and the same after a file."""
    with load_truth(truth_path, body) as truth:
        own = condensation if condensed else None
        result = train_internal(truth, body, own, (16, 16), 10, settings=SETTINGS)
        again = train_internal(truth, body, own, (16, 16), 10, settings=SETTINGS)
        assert result.held_out == again.held_out
        assert result.held_out.rms < 0.9
        state = int(read_internal_data(truth, body, own).held_out[0])
        rows, exact = truth.states["rows"][state], truth.internal(state)
        truth_hash = truth.content_hash
    path = tmp_path / "internal.safetensors"
    save_internal(path, result.model, body, truth_hash, result.held_out.rms)
    header, model, cubature = load_internal(path, body)
    assert cubature is None
    assert header.truth_hash == truth_hash
    assert model.options == result.model.options
    before, after = (
        InternalCorrection(each, body).bind().displacement(rows) for each in (result.model, model)
    )
    np.testing.assert_array_equal(before, after)
    start = own.corotated(rows).displacement(rows) if own is not None else np.zeros_like(exact)
    assert np.linalg.norm(start + after - exact) < np.linalg.norm(start - exact)
    with pytest.raises(SoftprintError, match="another body"):
        load_internal(path, other_body())
    path.write_bytes(path.read_bytes()[:-9])
    with pytest.raises(SoftprintError, match="train it again"):
        load_internal(path, body)


def other_body() -> ReducedBody:
    mesh = box_mesh([0.0, 0.0], [0.08, 0.02], [12, 3])
    return assemble_body(mesh, place_handles(mesh, 3, []), make_material("stable_neo_hookean", 2e4, 0.4), 1e3)


def test_a_linear_part_is_fitted_before_training(body, truth_path):
    """On the subspace most of a correction is linear mechanics: regression alone leaves less than training does in a
    few steps without it."""
    few = TrainingSettings(steps=1, batch=32, learning_rate=1e-6, weight_decay=0.0, validations=1, seed=0)
    with load_truth(truth_path, body) as truth:
        with_linear, without = (
            train_internal(truth, body, None, (8, 8), 10, linear, few) for linear in (True, False)
        )
    assert with_linear.held_out.rms < 0.5 < without.held_out.rms
    assert not torch.any(without.model.linear)


def test_a_correction_learned_under_gravity_knows_how_the_body_lies(body, tmp_path):
    """In a heavy body that is turned every way; what is not told cannot."""
    gravity, errors = (0.0, -100.0), []
    for number, told in enumerate((gravity, (0.0, 0.0))):
        with load_truth(written_truth(body, tmp_path / f"{number}.h5", gravity, told), body) as truth:
            result = train_internal(truth, body, None, (16, 16), 10, settings=SETTINGS)
            truth_hash = truth.content_hash
        errors.append(result.held_out.rms)
        path = tmp_path / f"{number}.safetensors"
        save_internal(path, result.model, body, truth_hash, result.held_out.rms)
        model = load_internal(path, body).model
        assert model.options == result.model.options
        assert model.options.gravity == (told if any(told) else ())
        at_rest = InternalCorrection(model, body).bind().displacement(body.rest_rows)
        assert bool(np.abs(at_rest).max() > 1e-5) == any(told)  # m: it sags
    assert errors[0] < 0.5 * errors[1]


@pytest.mark.parametrize("condensed", [False, True])
def test_a_cubature_learned_from_states_is_nearer_than_that_of_the_body(
    body, condensation, truth_path, condensed, tmp_path
):
    """In states that it was not fitted to, with no more cells; with all cells it is exact. And it is in the file."""
    with load_truth(truth_path, body) as truth:
        own = condensation if condensed else None
        result = train_internal(truth, body, own, (16, 16), 10, settings=SETTINGS)
        data, rows = read_internal_data(truth, body, own), truth.states["rows"]
        truth_hash = truth.content_hash
    internal = InternalCorrection(result.model, body)
    count = len(body.cubature.cells) // 2
    cubature, (_, force) = fitted_cubature(
        body, internal, own, rows[data.train], rows[data.held_out], count, np.random.default_rng(1)
    )
    assert len(cubature.cells) <= count
    assert (cubature.weights > 0.0).all()
    assert cubature.force_error < 0.5 * force
    system = force_system(body, internal, own, rows[:2])
    exact = system.errors(system.cells, body.mesh.cell_volumes[system.cells])
    assert max(exact) < 1e-6  # B is in single precision
    path = tmp_path / "internal.safetensors"
    save_internal(path, result.model, body, truth_hash, result.held_out.rms, None, cubature)
    loaded = load_internal(path, body)
    assert loaded.cubature is not None
    np.testing.assert_array_equal(loaded.on(body).cubature.cells, cubature.cells)
    np.testing.assert_array_equal(loaded.on(body).cubature.weights, cubature.weights)
    assert loaded.on(body).content_hash == body.content_hash


def test_the_forces_of_the_system_are_those_of_the_energy(body, truth_path):
    """On the subspace: the derivative by each coordinate, of all cells."""
    with load_truth(truth_path, body) as truth:
        result = train_internal(truth, body, None, (8, 8), 6, settings=SETTINGS)
        rows = truth.states["rows"][9]
    internal = InternalCorrection(result.model, body)
    bound, handles = internal.bind(), body.handles
    scale = dof_scale(body.mesh, handles)

    def energy(at: Array) -> float:
        return elastic_energy(body.mesh, body.material, body.reduced_positions(at) + bound.displacement(at))

    step, found = 1e-6, []
    for index in range(handles.n_dofs):
        ahead = np.zeros(handles.n_dofs)
        ahead[index] = step * scale[index]
        found.append(
            (energy(handles.retract(rows, ahead)) - energy(handles.retract(rows, -ahead))) / (2 * step)
        )
    expected = np.array(found) / np.linalg.norm(found)
    system = force_system(body, internal, None, rows[None])
    np.testing.assert_allclose(system.whole[0], expected, atol=1e-5)  # B is in single precision


@pytest.mark.parametrize("condensed", [False, True])
def test_corrections_from_exact_targets_are_full_space_equilibria(body, condensation, truth_path, condensed):
    """Only the state is held: outside frames, forces are combinations of what holds it."""
    with load_truth(truth_path, body) as truth:
        own = condensation if condensed else None
        data = read_internal_data(truth, body, own)
        rows, r = truth.states["rows"][-1], data.fields[-1]
    x = body.reduced_positions(rows) + mapped(basis_gradient_at_nodes(body), rows, r)
    bare = body.reduced_positions(rows)
    if own is not None:
        x += own.corotated(rows).displacement(rows)
    free = np.setdiff1d(np.arange(body.n_nodes), body.handles.frame_nodes)
    C = body.constraint_basis[free]

    def unbalanced(at: Array) -> float:
        force = elastic_gradient(body.mesh, body.material, at)[free]
        return float(np.linalg.norm(force - C @ np.linalg.lstsq(C, force, rcond=None)[0]))

    # The tolerance of the solve that made the truth.
    assert unbalanced(x) < 1e-5 * unbalanced(bare)
