"""Refuses arguments of another kind, states of other scenes, and mechanics and internal corrections that do not fit a
body or each other."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from softprint.runtime.arrays import Array
from softprint.runtime.body.body import ReducedBody
from softprint.runtime.dynamics.state import ReducedState
from softprint.runtime.elasticity.displacement_field import InternalField
from softprint.runtime.errors import SoftprintError
from softprint.runtime.mechanics.body_mechanics import BodyMechanics


def check_kind(what: str, value: object, kind: type) -> None:
    """Raises SoftprintError for an argument that is not of its kind."""
    if not isinstance(value, kind):
        raise SoftprintError(f"{what} must be a {kind.__name__}, not a {type(value).__name__}")


def check_state(state: object, names: Iterable[str]) -> None:
    """Raises SoftprintError for what is no state, and for one of a scene with other colliders than those with these
    names."""
    check_kind("the state", state, ReducedState)
    assert isinstance(state, ReducedState)
    other = sorted({*names} ^ state.poses.keys())
    if other:
        raise SoftprintError(
            f"the state is of a scene with other colliders ({', '.join(other)} in one of the two): start from "
            "`rest_state` of this simulator"
        )


def check_mechanics(body: ReducedBody, mechanics: BodyMechanics | None) -> None:
    """Raises SoftprintError for mechanics of another body."""
    if mechanics is not None:
        check_kind("mechanics", mechanics, BodyMechanics)
        mechanics.check_body(body)
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
