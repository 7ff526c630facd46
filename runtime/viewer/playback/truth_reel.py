"""The samples of a truth file as a reel, in their order."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from softprint.runtime.arrays import Array
from softprint.runtime.colliders import Collider
from softprint.runtime.errors import SoftprintError
from softprint.runtime.inspect.picture import known_colliders
from softprint.runtime.io.files import open_softprint_h5
from softprint.runtime.mesh.mesh import Mesh
from softprint.runtime.truth.truth_file import load_truth
from softprint.runtime.truth.truth_schema import CONVERGED, KIND, VERSION
from softprint.runtime.viewer.playback.reel import DISPLACEMENT, PRESSURE, STRAIN, Measured, Still

_CONTACT = "contact displacement"


class TruthReel:
    """See `Reel`: the converged samples. experiment: defines the colliders, None to leave them out. Raises
    SoftprintError for anything but a whole truth file, and for one without a converged sample."""

    times: Array | None = None
    forces: Array | None = None

    def __init__(self, path: Path, experiment: Path | None) -> None:
        self._truth = load_truth(path)
        truth = self._truth
        self._samples = np.flatnonzero(truth.samples["status"] == CONVERGED)
        if not len(self._samples):
            raise SoftprintError(f"{path}: none of its {truth.n_samples} samples has converged")
        self.name = path.name
        names = list(truth.header.colliders)
        self.colliders: Mapping[str, Collider] = {}
        if experiment is not None:
            self.colliders = known_colliders(names, experiment)
        self._names = names
        with open_softprint_h5(path, KIND, VERSION) as file:
            states = np.unique(truth.sample_state[self._samples])
            self._states = {int(state): file[f"view/points_{state}"][()] for state in states}
            cells = file["mesh/cells"][()]
            self.rest = Mesh(file["mesh/points"][()], cells)
        self._measured = Measured(self.rest)
        stiffness = truth.header.made_from.get("contact.stiffness")
        self._stiffness = None if stiffness is None else float(json.loads(stiffness))
        pressed = (PRESSURE,) if self.colliders and self._stiffness is not None else ()
        self.quantities: tuple[str, ...] = (_CONTACT, DISPLACEMENT, *pressed, STRAIN, "nothing")

    @property
    def count(self) -> int:
        """Converged samples."""
        return len(self._samples)

    def still(self, index: int) -> Still:
        """See `Reel`."""
        truth, sample = self._truth, int(self._samples[index])
        state = int(truth.sample_state[sample])
        points = self._states[state] + truth.displacement(sample)
        name = self._collider(sample)
        title = (
            f"sample {sample} of {truth.n_samples}: state {state}, {name}, "
            f"{1e3 * float(truth.samples['depth'][sample]):.2f} mm deep, residual "
            f"{float(truth.samples['residual'][sample]):.1e}"
        )
        notes = [
            (truth.pierced[sample], "pierced"),
            (truth.inverted[sample], "inverted cells"),
            (truth.samples["branch_flag"][sample], "jumped to another branch"),
        ]
        told = [note for flag, note in notes if flag]
        poses = {name: truth.pose(sample)} if name in self.colliders else {}
        return Still(points, poses, ", ".join([title, *told]), bool(told))

    def values(self, index: int, still: Still, quantity: str) -> Array:
        """See `Reel`. Pressure is k d^2 of the penalty law at the depth d of every drawn node."""
        nodes, sample = self._measured.nodes, int(self._samples[index])
        if quantity == _CONTACT:
            return np.asarray(1e3 * np.linalg.norm(self._truth.displacement(sample)[nodes], axis=1))
        if quantity == DISPLACEMENT:
            return self._measured.displacement(still.positions)
        if quantity == STRAIN:
            return self._measured.strain(still.positions)
        if quantity == PRESSURE and self._stiffness is not None:
            pressure = np.zeros(len(nodes))
            for name, pose in still.poses.items():
                depth = np.maximum(-self.colliders[name].sdf(pose.apply_inverse(still.positions[nodes])), 0.0)
                pressure += 1e-3 * self._stiffness * depth**2
            return pressure
        return np.full(len(nodes), np.nan)

    def _collider(self, sample: int) -> str:
        number = int(self._truth.contacts["collider"][self._truth.samples["contact"][sample]])
        if not 0 <= number < len(self._names):
            raise SoftprintError(
                f"{self._truth.path}: sample {sample} is of a collider without a name: make it again"
            )
        return self._names[number]
