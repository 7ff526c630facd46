"""A beam with three rigid frames, and states in which it is bent at both joints."""

import numpy as np

from softprint.runtime.body import assemble_body, frame_in_box, place_handles
from softprint.runtime.body.rotations import rotation_exponential
from softprint.runtime.elasticity.materials import make_material
from softprint.runtime.mesh.box import box_mesh


def beam_with_joints(dim):
    """With frames in its middle, at its right and at its left end, in this order."""
    mesh = box_mesh([0.0] * dim, [0.3] + [0.04] * (dim - 1), [24] + [3] * (dim - 1))
    boxes = {"middle": (0.13, 0.17), "right": (0.26, 1.0), "left": (-1.0, 0.04)}
    frames = [
        frame_in_box(mesh, name, [[low] + [-1.0] * (dim - 1), [high] + [1.0] * (dim - 1)])
        for name, (low, high) in boxes.items()
    ]
    handles = place_handles(mesh, 2, frames)
    return assemble_body(mesh, handles, make_material("stable_neo_hookean", 2e4, 0.4), 1000.0)


def bent(body, *angles):
    """Rows with the frames turned about their pivots by angles about the last axis."""
    rows, dim = body.rest_rows.copy(), body.dim
    for frame, angle in zip(body.handles.frames, angles, strict=True):
        R = rotation_exponential(np.array([angle] if dim == 2 else [0.0, 0.0, angle]))
        rows[body.handles.rows_of(frame.name)] = np.vstack([R.T, frame.pivot - R @ frame.pivot])
    return rows
