"""Springs on handles in full space: they act on the projection of a point handle and on the region of a frame.

A spring on a point acts on its row in the reduced state of the body (`ReducedBody.project`), as in the reduced model.
Its force is then spread like those that hold a state in the truth. On a single node it would be a point load, whose
displacement depends on the size of the cells: on the small Ball it was half of what the subspace misses.

A frame's position is the mean of the nodes of its region; its orientation is the least-squares
linear fit A of x_i - mean(x) = A (X_i - mean(X)), so that  k_r/4 |A - R_target|^2  is a sum of dim linear
springs; an anchor X_a is at mean(x) + A (X_a - mean(X)). For a rigid region both agree with the springs of the
reduced model, `runtime.dynamics.terms.springs`.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from softprint.fem_truth.energy.potentials import LinearSpring
from softprint.runtime.arrays import Array
from softprint.runtime.dynamics.terms.springs import HandleSpring

if TYPE_CHECKING:
    from softprint.runtime.body import ReducedBody


def linear_springs(springs: Sequence[HandleSpring], body: ReducedBody, time: float) -> list[LinearSpring]:
    """The potentials of all springs with their targets at ``time`` [s]."""
    result = []
    for spring in springs:
        pose = spring.target.pose(time)
        if not isinstance(spring.handle, str):
            weights = body.point_projection[spring.handle]
            result.append(LinearSpring(weights, spring.stiffness, pose.translation))
            continue
        mean, fit = _region_weights(body, spring.handle)
        pulled = mean if spring.anchor is None else mean + (spring.anchor - mean @ body.mesh.points) @ fit
        result.append(LinearSpring(pulled, spring.stiffness, pose.translation))
        if spring.rotation_stiffness:
            # row j of A^T is fit[j] @ x; its target is row j of R_target^T
            half = 0.5 * spring.rotation_stiffness
            result += [LinearSpring(fit[j], half, pose.rotation[:, j]) for j in range(body.dim)]
    return result


def _region_weights(body: ReducedBody, name: str) -> tuple[Array, Array]:
    """Node weights: mean (n_nodes,) of the region; fit (dim, n_nodes) with A^T = fit @ x."""
    frame = next(frame for frame in body.handles.frames if frame.name == name)
    mean = np.zeros(body.n_nodes)
    mean[frame.nodes] = 1.0 / len(frame.nodes)
    offsets = body.mesh.points[frame.nodes] - body.mesh.points[frame.nodes].mean(axis=0)
    fit = np.zeros((body.dim, body.n_nodes))
    fit[:, frame.nodes] = np.linalg.pinv(offsets)
    return mean, fit
