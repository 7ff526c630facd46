"""The radius d of descriptors: deformation on a larger scale is represented by the handles (thesis 6.2.1)."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from softprint.runtime.body.body import ReducedBody
from softprint.runtime.errors import SoftprintError


def handle_spacing(body: ReducedBody) -> float:
    """d [m]: the mean over all handles of the rest distance to the nearest other one; a frame is at its pivot.

    Raises SoftprintError for a body with fewer than two handles.
    """
    pivots = [frame.pivot for frame in body.handles.frames]
    places = np.vstack([body.mesh.points[body.handles.points], *pivots])
    if len(places) < 2:
        raise SoftprintError(
            f"body {body.name!r} has {len(places)} handle(s): the radius of a descriptor is the distance between "
            "handles, so it needs two or more"
        )
    distance, _ = cKDTree(places).query(places, k=2)
    return float(distance[:, 1].mean())
