"""Other ways to evaluate a descriptor model, for comparison with `DescriptorCorrection`: those of thesis 6.3, and
random tangents."""

from __future__ import annotations

from itertools import product

import numpy as np

from softprint.runtime.arrays import Array, IntArray
from softprint.runtime.body.material_points import MaterialPoints
from softprint.runtime.colliders.collider import Collider
from softprint.runtime.learned.thesis6.correction import BoundDescriptorCorrection, DescriptorCorrection
from softprint.runtime.learned.thesis6.descriptors import random_frames
from softprint.runtime.learned.thesis6.inputs import inputs_in_frame


class RandomTangents(BoundDescriptorCorrection):
    """Tangents drawn anew at every evaluation (thesis, figure 6.5)."""

    def __init__(
        self, correction: DescriptorCorrection, points: MaterialPoints, rng: np.random.Generator
    ) -> None:
        super().__init__(correction, points, np.inf)
        self._rng = rng

    def predict(self, z: Array, relative: Array) -> Array:
        """See `BoundDescriptorCorrection.predict`."""
        R = random_frames(self._geometry.normal(z), self._rng)
        phi = self._model.descriptor.values(self._geometry, z, R)
        return np.einsum("nab,nb->na", R, self._model.evaluate(inputs_in_frame(phi, relative, R)))


class OneBias(BoundDescriptorCorrection):
    """Tangents t1 = n x e1 alone, as in the thesis: not defined where n is along e1."""

    def predict(self, z: Array, relative: Array) -> Array:
        """See `BoundDescriptorCorrection.predict`."""
        R = one_bias(self._geometry.normal(z))
        phi = self._model.descriptor.values(self._geometry, z, R)
        return np.einsum("nab,nb->na", R, self._model.evaluate(inputs_in_frame(phi, relative, R)))


class GridOfDescriptors:
    """Frames and descriptors at the nodes of a regular grid around a collider, `cells` along the largest side of its
    bounds enlarged by d, only where points within d of the surface ask for them (thesis 6.3.1)."""

    def __init__(self, correction: DescriptorCorrection, collider: Collider, cells: int) -> None:
        d, dim = correction.support, collider.dim
        lower, upper = collider.lower - d, collider.upper + d
        self.spacing = float((upper - lower).max()) / cells
        self.origin = lower - self.spacing
        self.shape = np.ceil((upper - lower) / self.spacing).astype(int) + 3
        nodes = self.origin + self.spacing * np.indices(self.shape).reshape(dim, -1).T
        self.used = np.flatnonzero(collider.sdf(nodes) < d + np.sqrt(dim) * self.spacing)
        there = nodes[self.used]
        self.place = np.full(len(nodes), -1)
        self.place[self.used] = np.arange(len(self.used))
        self.rotation = one_bias(correction.geometry.normal(there))
        self.phi = correction.model.descriptor.values(correction.geometry, there, self.rotation)

    def corners(self, z: Array) -> tuple[IntArray, Array]:
        """Which nodes surround points z (n, dim), and their trilinear weights; both (n, 2^dim)."""
        t = (z - self.origin) / self.spacing
        cell = np.floor(t).astype(int)
        f = t - cell
        numbers, weights = [], []
        for corner in product((0, 1), repeat=z.shape[1]):
            numbers.append(np.ravel_multi_index(tuple((cell + corner).T), tuple(self.shape)))
            weights.append(np.prod(np.where(corner, f, 1.0 - f), axis=1))
        return self.place[np.stack(numbers, axis=1)], np.stack(weights, axis=1)

    def turning(self, z: Array) -> Array:
        """(n,) largest angle between the frames of the first corner and of another one of the cells of z (n, dim)."""
        R = self.rotation[self.corners(z)[0]]
        cosine = 0.5 * (np.einsum("nab,ncab->nc", R[:, 0], R) - (z.shape[1] - 2))
        return np.arccos(np.clip(cosine.min(axis=1), -1.0, 1.0))


class CornerDeformations(BoundDescriptorCorrection):
    """The thesis's way: the network at the eight corners of a cell, their deformations interpolated (6.3.2)."""

    def __init__(
        self, correction: DescriptorCorrection, points: MaterialPoints, grid: GridOfDescriptors
    ) -> None:
        super().__init__(correction, points, np.inf)
        self._grid = grid

    def predict(self, z: Array, relative: Array) -> Array:
        """See `BoundDescriptorCorrection.predict`."""
        numbers, weights = self._grid.corners(z)
        u = np.zeros_like(z)
        for corner, weight in zip(numbers.T, weights.T, strict=True):
            R = self._grid.rotation[corner]
            r = self._model.evaluate(inputs_in_frame(self._grid.phi[corner], relative, R))
            u += weight[:, None] * np.einsum("nab,nb->na", R, r)
        return u


class CornerDescriptors(CornerDeformations):
    """The cheaper way that the thesis rejects: descriptors and frames interpolated, the network once (figure 6.7).

    mended: the nearest frame is taken of what interpolation makes of frames; otherwise it is used as it is."""

    def __init__(
        self, correction: DescriptorCorrection, points: MaterialPoints, grid: GridOfDescriptors, mended: bool
    ) -> None:
        super().__init__(correction, points, grid)
        self._mended = mended

    def predict(self, z: Array, relative: Array) -> Array:
        """See `BoundDescriptorCorrection.predict`."""
        numbers, weights = self._grid.corners(z)
        phi = np.einsum("nc,ncm->nm", weights, self._grid.phi[numbers])
        R = np.einsum("nc,ncab->nab", weights, self._grid.rotation[numbers])
        if self._mended:
            left, _, right = np.linalg.svd(R)
            R = left @ right
        return np.einsum("nab,nb->na", R, self._model.evaluate(inputs_in_frame(phi, relative, R)))


def one_bias(normal: Array) -> Array:
    """R (n, dim, dim) of t1 = n x (1, 0, 0) (thesis 6.2.2)."""
    if normal.shape[1] == 2:
        return random_frames(normal, np.random.default_rng(0))  # there is one choice
    first = np.cross(normal, [1.0, 0.0, 0.0])
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    return np.stack([normal, first, np.cross(normal, first)], axis=-1)
