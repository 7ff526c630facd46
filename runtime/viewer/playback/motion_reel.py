"""A motion file as a reel."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from softprint.runtime.arrays import Array
from softprint.runtime.colliders import Collider
from softprint.runtime.io.files import open_softprint_h5
from softprint.runtime.mesh.mesh import Mesh
from softprint.runtime.scenes.motion_colliders import build_colliders
from softprint.runtime.scenes.motion_file import KIND, VERSION, load_motion
from softprint.runtime.viewer.playback.reel import DIFFERENCE, DISPLACEMENT, STRAIN, Measured, Still


class MotionReel:
    """See `Reel`. Raises SoftprintError for anything but a whole motion file. Positions are read frame by frame."""

    quantities: tuple[str, ...] = (DISPLACEMENT, DIFFERENCE, STRAIN, "nothing")

    def __init__(self, path: Path) -> None:
        self._motion = load_motion(path)
        motion = self._motion
        with open_softprint_h5(path, KIND, VERSION) as file:
            self.rest = Mesh(file["mesh/points"][()], file["mesh/cells"][()])
        self.name = f"{motion.scene} · {motion.model}"
        self.colliders: Mapping[str, Collider] = build_colliders(motion.collider_tables, path)
        self.times: Array | None = motion.times
        totals = [np.linalg.norm(track.force, axis=1) for track in motion.colliders.values()]
        self.forces: Array | None = np.sum(totals, axis=0) if totals else np.zeros(motion.n_frames)
        self._measured = Measured(self.rest)

    @property
    def count(self) -> int:
        """Frames."""
        return self._motion.n_frames

    def still(self, index: int) -> Still:
        """See `Reel`."""
        motion = self._motion
        status = motion.status_names.get(int(motion.status[index]), "unknown")
        assert self.forces is not None
        title = (
            f"{motion.model}: {status.replace('_', ' ').lower()}, {int(motion.iterations[index])} Newton, residual "
            f"{float(motion.residual[index]):.1e}, {self.forces[index]:.2f} N"
        )
        poses = {name: track.poses[index] for name, track in motion.colliders.items()}
        return Still(motion.positions(index), poses, title, bool(motion.status[index]))

    def values(self, index: int, still: Still, quantity: str) -> Array:
        """See `Reel`; the difference from another motion is the page's."""
        if quantity == STRAIN:
            return self._measured.strain(still.positions)
        if quantity == DISPLACEMENT:
            return self._measured.displacement(still.positions)
        return np.full(len(self._measured.nodes), np.nan)
