"""Refuse a collider that is in another unit than the body."""

from __future__ import annotations

import numpy as np

from softprint.runtime.colliders.collider import Collider
from softprint.runtime.errors import SoftprintError

# A floor may be this many times as large as the body; a file in millimetres that is read in metres is larger.
LARGEST = 100.0


def check_size(collider: Collider, body_size: float) -> None:
    """Raises SoftprintError if a bounded collider is more than LARGEST times as large as the body. body_size: its
    largest extent [m]."""
    extent = float((collider.upper - collider.lower).max())
    if np.isfinite(extent) and extent > LARGEST * body_size:
        raise SoftprintError(
            f"collider {collider.name!r} is {extent:.3g} m large and the body {body_size:.3g} m: if the collider's "
            'file is in millimetres, say so with `unit = "mm"`'
        )
