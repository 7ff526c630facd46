"""Full-space solves at the frames of a motion, and the store of them."""

import numpy as np
import pytest

pytest.importorskip("dolfinx")

from softprint.fem_truth.elasticity.full_space_elasticity import FullSpaceElasticity
from softprint.fem_truth.report.measurements.solves import FrameSolves, SolveStore
from softprint.fem_truth.statics.constrained import ConstrainedProblem
from softprint.runtime.colliders.pose import RigidPose
from softprint.runtime.contact import PenaltyContact
from softprint.runtime.errors import SoftprintError


def test_a_full_space_equilibrium_is_its_own_constrained_equilibrium(jelly_body):
    """Without contact, the equilibrium at the projected state of a static full-space frame is that frame.

    The constraint is satisfied and the energy is least. Solved to 1e-7 of the forces, hence 1e-4 of the
    sag."""
    body = jelly_body
    gravity = np.zeros(body.dim)
    gravity[-1] = -9.81
    problem = ConstrainedProblem(FullSpaceElasticity(body), gravity, PenaltyContact(1e10), body)
    x = static_equilibrium(body, gravity)
    solution = problem.internal_equilibrium(body.project(x))
    assert solution.converged
    sag = np.abs(x - body.mesh.points).max()
    assert np.abs(solution.x - x).max() < 1e-4 * sag


def static_equilibrium(body, gravity):
    """(n_nodes, dim) of the body under its weight on its fixed base, by plain Newton steps."""
    from scipy.sparse.linalg import spsolve

    elasticity = FullSpaceElasticity(body)
    free = np.setdiff1d(np.arange(body.n_nodes), body.handles.frame_nodes)
    dofs = (free[:, None] * body.dim + np.arange(body.dim)).ravel()
    x = body.mesh.points.copy()
    for _ in range(12):
        force = elasticity.gradient(x) - np.outer(body.node_mass, gravity)
        hessian = elasticity.hessian(x).sparse().tocsc()[np.ix_(dofs, dofs)]
        x.reshape(-1)[dofs] -= spsolve(hessian, force.ravel()[dofs])
    return x


@pytest.fixture
def solves():
    rng = np.random.default_rng(0)
    return FrameSolves(*rng.normal(size=(3, 5, 2)), seconds=1.5, problem="")


def test_store_returns_solves_of_the_same_problem_only(tmp_path, solves):
    full, pose = np.arange(10.0).reshape(5, 2), RigidPose.identity(2)
    store = SolveStore(tmp_path / "heldout", "context")
    assert store.load(3, full, pose) is None
    store.save(3, full, pose, solves)
    found = store.load(3, full, pose)
    assert np.array_equal(found.exact, solves.exact)
    assert (found.seconds, found.problem) == (1.5, "")
    assert store.load(4, full, pose) is None
    assert store.load(3, full + 1e-9, pose) is None
    assert store.load(3, full, RigidPose(np.eye(2), np.array([0.0, 1e-9]))) is None
    assert SolveStore(tmp_path / "heldout", "another").load(3, full, pose) is None


def test_a_damaged_solve_is_made_again(tmp_path, solves):
    full, pose = np.zeros((5, 2)), RigidPose.identity(2)
    store = SolveStore(tmp_path, "context")
    store.save(0, full, pose, solves)
    path = next(tmp_path.glob("*.npz"))
    path.write_bytes(path.read_bytes()[:100])
    assert store.load(0, full, pose) is None


def test_no_half_written_file_is_left(tmp_path, solves, monkeypatch):
    def fail(*args, **kwargs):
        raise OSError("no space left on device")

    monkeypatch.setattr(np, "savez", fail)
    with pytest.raises(SoftprintError, match="no space"):
        SolveStore(tmp_path, "context").save(0, np.zeros((5, 2)), RigidPose.identity(2), solves)
    assert list(tmp_path.iterdir()) == []
