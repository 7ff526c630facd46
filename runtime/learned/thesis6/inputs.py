"""The network inputs of thesis chapter 6 at a point: the descriptor, and the positions of the handles."""

from __future__ import annotations

import numpy as np

from softprint.runtime.arrays import Array


def relative_rows(basis: Array, rows: Array, affine_part: Array, z: Array) -> Array:
    """W(X) T^-1 (q - x) (n, n_rows, dim) [m] in collider coordinates.

    basis: U (n, n_rows); rows: T^-1 q (n_rows, dim); affine_part: (n_rows,), see `Handles.affine_part`; z (n, dim).
    """
    relative = rows - affine_part[:, None] * z[:, None, :]
    relative *= basis[:, :, None]
    return np.asarray(relative)


def inputs_in_frame(descriptor: Array, relative: Array, rotation: Array) -> Array:
    """The network inputs (n, n_inputs): descriptor (n, m), and relative rows (n, n_rows, dim) rotated into the frames R
    (n, dim, dim)."""
    return np.concatenate([descriptor, (relative @ rotation).reshape(len(descriptor), -1)], axis=1)
