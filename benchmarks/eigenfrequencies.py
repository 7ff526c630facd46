"""How fast does a body vibrate in the subspace, and with static condensation, however its states are held?

    python -m benchmarks.eigenfrequencies examples/{jelly3d_small,ball_small,finger_small}.toml

The lowest frequencies of the mesh at rest with its rigid frames held, or free where it has none, and by what factor
they are higher in the subspace (bare), and with static condensation for the holds "projection" and "mass" (see
`ReducedBody.constraint_basis`). Condensation has the mass of the subspace alone, U^T M U; for comparison also with the
inertia of what settles, X^T M X with X = U + du/dq (Guyan 1965).

Needs `softprint body EXPERIMENT`. A body whose run is elsewhere is given as EXPERIMENT=DIRECTORY.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

import numpy as np
import scipy.sparse as sp
from scipy.linalg import eigh
from scipy.sparse.linalg import eigsh

from softprint.runtime.arrays import Array, IntArray
from softprint.runtime.body import ReducedBody
from softprint.runtime.cli.context import Context
from softprint.runtime.cli.run_body import body_of_run
from softprint.runtime.cli.script import run_script
from softprint.runtime.errors import SoftprintError
from softprint.runtime.mechanics.compliance.null_space_compliance import NullSpaceCompliance, rest_stiffness

COUNT = 10
HOLDS = ("projection", "mass")
# Of the shift that makes the stiffness of a free body invertible, as a share of its mean.
_SHIFT = 1e-5


class Vibration:
    """Those of a body, with its frames held."""

    def __init__(self, body: ReducedBody) -> None:
        self.body, self.stiffness = body, rest_stiffness(body)
        self.mass = np.repeat(body.node_mass, body.dim)
        self.subspace = np.kron(body.basis[:, : body.handles.n_points], np.eye(body.dim))
        # Rigid motions of a body without frames come first.
        self.n_rigid = 0 if body.handles.frames else body.dim * (body.dim + 1) // 2
        self.count = min(COUNT, self.subspace.shape[1] - self.n_rigid)

    def of_mesh(self) -> Array:
        """The lowest frequencies (n,) [1/s] of the mesh."""
        stiffness, mass = self.stiffness[self._free][:, self._free], self.mass[self._free]
        shift = -_SHIFT * stiffness.diagonal().mean() / mass.mean()
        wanted = self.n_rigid + self.count
        square = eigsh(
            stiffness.tocsc(), wanted, sp.diags(mass).tocsc(), sigma=shift, return_eigenvectors=False
        )
        return _frequencies(np.sort(square)[self.n_rigid :])

    def bare(self) -> Array:
        """Of the subspace."""
        return self._among(self.subspace, self.subspace)

    def condensed(self, hold: str) -> tuple[Array, Array]:
        """With static condensation: with the mass of the subspace, and with the inertia of what settles too."""
        body, shape = replace(self.body, hold=hold), self.body.mesh.points.shape
        forces = -(self.stiffness @ self.subspace).reshape(*shape, -1)
        settled = self.subspace + NullSpaceCompliance(body).solve(forces).reshape(len(self.mass), -1)
        return self._among(settled, self.subspace), self._among(settled, settled)

    def _among(self, moved: Array, with_mass: Array) -> Array:
        stiffness = moved.T @ (self.stiffness @ moved)
        square = eigh(stiffness, with_mass.T @ (self.mass[:, None] * with_mass), eigvals_only=True)
        return _frequencies(square[self.n_rigid : self.n_rigid + self.count])

    @property
    def _free(self) -> IntArray:
        body = self.body
        nodes = np.setdiff1d(np.arange(body.n_nodes), body.handles.frame_nodes)
        return (nodes[:, None] * body.dim + np.arange(body.dim)).ravel()


def _frequencies(square: Array) -> Array:
    return np.asarray(np.sqrt(np.maximum(square, 0.0)) / (2.0 * np.pi))


def table(name: str, body: ReducedBody) -> str:
    """The lines of one body."""
    if not body.handles.n_points:
        raise SoftprintError(
            f"{name}: a body without point handles, on which alone it depends how states are held"
        )
    vibration = Vibration(body)
    mesh = vibration.of_mesh()
    rows = [("the mesh, 1/s", mesh), ("the subspace, of that", vibration.bare() / mesh)]
    for hold in HOLDS:
        alone, whole = vibration.condensed(hold)
        rows += [(f"condensed, {hold}", alone / mesh), (f"{hold}, inertia of what settles", whole / mesh)]
    lines = [f"| {label} | {' | '.join(f'{value:.3g}' for value in values)} |" for label, values in rows]
    return "\n".join([f"| {name} |{' |' * len(mesh)}", f"| --- |{' --- |' * len(mesh)}", *lines])


def main() -> None:
    """Print a table for each body."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("experiments", nargs="+", help="experiment files, or EXPERIMENT=RUN_DIRECTORY")
    for given in parser.parse_args().experiments:
        file, _, out = given.partition("=")
        context = Context(experiment_path=Path(file), out=Path(out) if out else None)
        print(table(context.experiment.name, body_of_run(context)), "\n", flush=True)


if __name__ == "__main__":
    run_script(main)
