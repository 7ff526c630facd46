"""Far frames are lumped into near ones: what that changes, and what it must not."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from softprint.runtime.body import assemble_body, build_body, frame_in_box, handle_sparsity, place_handles
from softprint.runtime.body.handle_sparsity import CellGroup, HandleSparsity
from softprint.runtime.body.rotations import rotation_exponential
from softprint.runtime.dynamics.corrected_points import CorrectedPoints
from softprint.runtime.dynamics.terms.cell_group_blocks import CellGroupBlocks
from softprint.runtime.dynamics.terms.condensed_elastic import CondensedElasticEnergy
from softprint.runtime.elasticity import make_material
from softprint.runtime.experiment import load_experiment
from softprint.runtime.mechanics.compliance.null_space_compliance import NullSpaceCompliance
from softprint.runtime.mechanics.corotation import local_gradients
from softprint.runtime.mechanics.static_condensation import compute_static_condensation
from softprint.runtime.mesh import box_mesh

BONES = 6
EXAMPLES = Path(__file__).resolve().parents[3] / "examples"


@pytest.fixture(scope="module", params=[2, 3], ids=["2d", "3d"])
def chain(request):
    """A long bar with bones along it, and its static condensation under gravity."""
    dim = request.param
    mesh = box_mesh([0.0] * dim, [0.3, 0.03, 0.03][:dim], (60, 6, 3)[:dim])
    side = np.ones(dim - 1)
    bones = [
        frame_in_box(mesh, f"bone_{k}", [[0.05 * k + 0.01, *-side], [0.05 * k + 0.04, *side]])
        for k in range(BONES)
    ]
    material = make_material("stable_neo_hookean", 2e4, 0.4)
    body = assemble_body(mesh, place_handles(mesh, 0, bones), material, 1000.0, name="chain")
    condensation = compute_static_condensation(body, [0.0] * (dim - 1) + [-9.81], NullSpaceCompliance(body))
    return body, replace(condensation, rotation_gradients=local_gradients(body))


@pytest.fixture
def elastic_of(chain, monkeypatch):
    """The elastic energy with frames lumped that strain a cell by less than `least`, with one group for each set of
    near frames."""

    def make(least):
        monkeypatch.setattr(handle_sparsity, "_LEAST_STRAIN", least)
        monkeypatch.setattr(handle_sparsity, "_LEAST_STRAIN_OF_PARTS", 0.03 * least)
        monkeypatch.setattr(handle_sparsity, "_GROUP", 0.0)
        body, condensation = chain
        return CondensedElasticEnergy(body, CorrectedPoints(body, []), condensation)

    return make


def linearise(elastic, rows, frame_rows):
    """Energy, gradient and Hessian."""
    found = elastic.in_frame(frame_rows).evaluate(rows, None)
    return found.energy, *found.linearise(None)


def bent(body, angle, seed=0):
    """Every bone rotated and translated independently, by this angle and by a hundredth of it in metres."""
    handles, rng = body.handles, np.random.default_rng(seed)
    units = np.full(handles.n_dofs // BONES, angle)
    units[: body.dim] *= 0.01
    return handles.retract(body.rest_rows, np.tile(units, BONES) * rng.uniform(-1.0, 1.0, handles.n_dofs))


def test_rigid_motions_strain_nothing_however_much_is_lumped(chain, elastic_of):
    """To round-off, of the forces of a bend of 0.1. Gravity, which strains the body at rest, is rotated along."""
    body, condensation = chain
    elastic = elastic_of(0.3)
    assert elastic.products < 0.5 * elastic_of(0.0).products
    angles = np.array([2.0] if body.dim == 2 else [1.2, -0.5, 1.4])
    R, t = rotation_exponential(angles), np.arange(1.0, body.dim + 1.0)
    rest, bend = body.rest_rows, bent(body, 0.1)
    rigid = rest @ R.T + np.outer(condensation.affine_part, t)
    force = linearise(elastic, bend, bend)[1]
    rotated = replace(condensation, gravity=R @ condensation.gravity)
    elastic_rotated = CondensedElasticEnergy(body, CorrectedPoints(body, []), rotated)
    before, after = linearise(elastic, rest, rest), linearise(elastic_rotated, rigid, rigid)
    assert after[0] == pytest.approx(before[0], rel=1e-9)
    np.testing.assert_allclose(after[1], before[1] @ R.T, atol=1e-9 * np.abs(force).max())


def test_gradient_and_hessian_are_those_of_the_energy(chain, elastic_of):
    """With far frames lumped it is another energy, but still an energy: central differences, the rotations fixed."""
    body, _ = chain
    elastic = elastic_of(0.1)
    rows, frame_rows = bent(body, 0.3), bent(body, 0.28)
    _, gradient, hessian = linearise(elastic, rows, frame_rows)
    along = np.random.default_rng(2).normal(size=rows.shape)
    h = 1e-6

    def at(step):
        return linearise(elastic, rows + step * along, frame_rows)

    slope = (at(h)[0] - at(-h)[0]) / (2.0 * h)
    # Second order in h, and round-off of the energy.
    assert np.vdot(gradient, along) == pytest.approx(slope, rel=1e-6)
    curved = (at(h)[1] - at(-h)[1]) / (2.0 * h)
    # The Hessian is in single precision.
    np.testing.assert_allclose(
        hessian() @ along.ravel(), curved.ravel(), rtol=0, atol=3e-6 * np.abs(curved).max()
    )
    T = body.handles.tangent(rows)
    expected = T.T @ hessian() @ T
    np.testing.assert_allclose(hessian(T), expected, rtol=0, atol=3e-6 * np.abs(expected).max())


@pytest.mark.parametrize("least", [0.1, 0.01, 0.001])
def test_forces_change_by_less_than_the_threshold(chain, elastic_of, least):
    """A lumped frame rotates by less than a right angle relative to the frame that it is lumped into."""
    body, _ = chain
    rows, frame_rows = bent(body, 0.3), bent(body, 0.28)
    full = linearise(elastic_of(0.0), rows, frame_rows)
    near = linearise(elastic_of(least), rows, frame_rows)
    assert near[0] == pytest.approx(full[0], rel=least)
    assert 0.0 < np.linalg.norm(near[1] - full[1]) < least * np.linalg.norm(full[1])
    assert np.linalg.norm(near[2]() - full[2]()) < least * np.linalg.norm(full[2]())


def test_nodes_move_as_before_up_to_the_threshold(chain, monkeypatch):
    """Exactly for rigid motions; bent, up to the influence of all far frames together."""
    body, condensation = chain
    rng = np.random.default_rng(8)
    moved = condensation.unrotated_jacobian().reshape(body.n_nodes, body.dim, -1)
    moved = moved + 1e-4 * rng.normal(size=moved.shape)  # every node depends on every frame, if only a little
    monkeypatch.setattr(handle_sparsity, "_LEAST_DISPLACEMENT", 0.01)
    kept = HandleSparsity(body).sparsified(moved)
    near = kept.reshape(body.n_nodes, body.dim, BONES, -1).any(axis=(1, 3))
    assert 1.0 < near.sum(axis=1).mean() < 0.7 * BONES
    alike = np.tile(rng.normal(size=(1, body.dim + 1, body.dim)), (BONES, 1, 1)).ravel()
    np.testing.assert_allclose(kept @ alike, moved @ alike, atol=1e-12 * np.abs(moved @ alike).max())
    d = (bent(body, 0.3) - body.rest_rows).ravel()
    far = (BONES - near.sum(axis=1)).max()
    change = np.linalg.norm((kept - moved) @ d, axis=1)
    assert 0.0 < change.max() < far * 0.01 * body.mesh.size


def test_with_every_frame_near_nothing_is_changed(chain, elastic_of):
    """One group of all cells, and B as it was."""
    body, _ = chain
    elastic = elastic_of(0.0)
    assert elastic.products == len(body.cubature.cells) * body.dim**2 * (body.n_rows * body.dim) ** 2


@pytest.mark.parametrize("dim", [2, 3])
def test_blocks_do_what_the_whole_matrix_does(dim):
    """Cells in groups of different sizes, that depend on different rows."""
    rng, n_rows, m = np.random.default_rng(4), 7, 9
    groups = [
        CellGroup(np.array([1, 4, 8]), np.array([0, 3])),
        CellGroup(np.array([0, 2, 3, 5, 6]), np.arange(7)),
        CellGroup(np.array([7]), np.array([2, 5, 6])),
    ]
    B = np.zeros((m, dim * dim, n_rows, dim))
    for cells, rows in groups:
        B[cells[:, None], :, rows] = rng.normal(size=(len(cells), len(rows), dim * dim, dim))
    B = B.reshape(m, dim * dim, -1)
    where = CellGroupBlocks(groups, n_rows, dim)
    blocks = where.packed(B)
    flat = where.dense(blocks)
    np.testing.assert_array_equal(flat, B.reshape(flat.shape))
    change, stress = rng.normal(size=n_rows * dim), rng.normal(size=(m, dim, dim))
    np.testing.assert_allclose(where.times(blocks, change).ravel(), flat @ change, atol=1e-13)
    np.testing.assert_allclose(where.gathered(blocks, stress), stress.ravel() @ flat, atol=1e-13)
    R = np.array([rotation_exponential(w) for w in rng.normal(size=(m, 2 * dim - 3))])
    rotated = np.einsum("cia,cajrb,cdb->cijrd", R, B.reshape(m, dim, dim, n_rows, dim), R)
    rows = rng.normal(size=(n_rows, dim))
    in_world = where.to_world(blocks.astype(np.float32), R)
    rotated = rotated.reshape(flat.shape)
    np.testing.assert_allclose(where.dense(in_world), rotated, atol=1e-5)  # single precision
    of_rows = (rotated @ rows.ravel()).reshape(m, dim, dim)
    np.testing.assert_allclose(R @ where.seen(blocks, R, rows), of_rows, atol=1e-13)
    A = rng.normal(size=(m, dim * dim, dim * dim))
    A += A.transpose(0, 2, 1)
    expected = np.einsum("csk,cst,ctl->kl", B, A, B)
    along = rng.normal(size=(n_rows * dim, 5)) * (rng.random(size=(n_rows * dim, 5)) < 0.2)
    tangent = A.reshape(m, dim, dim, dim, dim)
    # Single precision.
    error = 1e-5 * np.abs(expected).max()
    np.testing.assert_allclose(where.stiffness(blocks, tangent), expected, rtol=0, atol=error)
    np.testing.assert_allclose(
        where.stiffness(blocks, tangent, along), along.T @ expected @ along, rtol=0, atol=error
    )


@pytest.fixture(scope="module", params=["worm_small", "worm"])
def worm(request):
    """The body of an example: three thin bones in much flesh. The larger mesh has as many cubature cells."""
    experiment = load_experiment(EXAMPLES / f"{request.param}.toml")
    return build_body(experiment.body, experiment.base_dir)


def test_frames_are_far_only_where_finite_turns_show_it(worm, monkeypatch):
    """With the head turned by a right angle, lumping moves no node by more than twice its threshold: there may be two
    far frames. Nodes beside a bone are carried by it and hardly answer to a small turn: if only those counted, some
    would move by thirty times the threshold."""
    response, handles = NullSpaceCompliance(worm), worm.handles
    rows = handles.retract(worm.rest_rows, 0.5 * np.pi * np.eye(handles.n_dofs)[-1])
    lumped = compute_static_condensation(worm, None, response)
    monkeypatch.setattr(HandleSparsity, "sparsified", lambda self, modes: modes)
    exact = compute_static_condensation(worm, None, response)
    moved, expected = (np.tensordot(one.modes, rows - worm.rest_rows, 2) for one in (lumped, exact))
    least = handle_sparsity._LEAST_DISPLACEMENT * worm.mesh.size
    assert 0.0 < np.linalg.norm(moved - expected, axis=1).max() < 2.0 * least


def test_the_energy_of_a_bent_joint_grows_with_the_square_of_its_angle(worm):
    """As in full space, to 6 % from 0.1 to 0.4 rad. If only small turns counted where frames are lumped, it would grow
    eight times as fast on the coarse mesh, and if the stiffness that the cubature misses answered to cosines, it would
    fall below zero on the fine one. Both worms would turn over."""
    condensation = compute_static_condensation(worm, None, NullSpaceCompliance(worm))
    elastic = CondensedElasticEnergy(worm, CorrectedPoints(worm, [], surface=False), condensation)
    joint = np.array([0.12, 0.0])

    def energy(angle):
        R = rotation_exponential(np.array([angle]))
        rows = worm.handles.with_frame(worm.rest_rows, "head", R, joint - R @ joint)
        return elastic.in_frame(rows).evaluate(rows, None).energy

    assert energy(0.4) / (16.0 * energy(0.1)) == pytest.approx(1.0, abs=0.3)
