"""Refuses mechanics and internal corrections that do not fit a body or each other."""

from __future__ import annotations

import numpy as np

from softprint.runtime.arrays import Array
from softprint.runtime.body.body import ReducedBody
from softprint.runtime.elasticity.displacement_field import InternalField
from softprint.runtime.errors import SoftprintError
from softprint.runtime.mechanics.body_mechanics import BodyMechanics


def check_mechanics(body: ReducedBody, mechanics: BodyMechanics | None) -> None:
    """Raises SoftprintError for mechanics of another body."""
    condensation = None if mechanics is None else mechanics.condensation
    if condensation is not None and len(condensation) != body.n_nodes:
        raise SoftprintError(
            f"the static condensation is of {len(condensation)} nodes, but the body has {body.n_nodes}: "
            "give that of all of them"
        )


def check_internal(internal: InternalField | None, mechanics: BodyMechanics | None, gravity: Array) -> None:
    """Raises SoftprintError for an internal correction with other mechanics than it was trained on, and for one that
    was trained under another gravity (dim,) [m/s^2]."""
    if internal is None:
        return
    if internal.gravity and not np.allclose(internal.gravity, gravity, rtol=1e-6, atol=1e-9):
        raise SoftprintError(
            f"the internal correction was trained under a gravity of {list(internal.gravity)} m/s^2, not of "
            f"{gravity.tolist()}: train it for this one"
        )
    condensed = mechanics is not None and mechanics.condensation is not None
    if internal.on_condensation and not condensed:
        raise SoftprintError(
            "the internal correction was trained on static condensation: give the mechanics of the body"
        )
    if condensed and not internal.on_condensation:
        raise SoftprintError(
            "the internal correction was trained on the subspace alone: leave static condensation out"
        )
