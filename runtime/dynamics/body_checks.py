"""Refuses arguments of another kind, states of other scenes, and mechanics and internal corrections that do not fit a
body or each other."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Protocol

import numpy as np

from softprint.runtime.arrays import Array
from softprint.runtime.body.body import ReducedBody
from softprint.runtime.contact.condensed.condensed_contact import CondensedContact
from softprint.runtime.dynamics.state import ReducedState
from softprint.runtime.elasticity.displacement_field import InternalField
from softprint.runtime.errors import SoftprintError
from softprint.runtime.mechanics.body_mechanics import BodyMechanics


def check_kind(what: str, value: object, kind: type) -> None:
    """Raises SoftprintError for an argument that is not of its kind."""
    if not isinstance(value, kind):
        raise SoftprintError(f"{what} must be a {kind.__name__}, not a {type(value).__name__}")


class Named(Protocol):
    """What has a name."""

    @property
    def name(self) -> str: ...


def check_state(
    state: object, body: ReducedBody, colliders: Iterable[Named], contact: CondensedContact | None
) -> None:
    """Raises SoftprintError for what is no state of this body with these colliders, and for one that stores contact at
    points that its condensed contact does not have: points are numbered."""
    check_kind("the state", state, ReducedState)
    assert isinstance(state, ReducedState)
    other = sorted({collider.name for collider in colliders} ^ state.poses.keys())
    if other:
        raise SoftprintError(
            f"the state is of a scene with other colliders ({', '.join(other)} in one of the two): start from "
            "`rest_state` of this simulator"
        )
    body.handles.check_rows(state.rows, "rows of the state")
    if contact is None:
        return
    points = -1 if state.contact is None else int(state.contact.index.max(initial=-1))
    nodes = -1 if state.friction is None else int(state.friction.nodes.max(initial=-1))
    if points >= len(contact.stiffness) or nodes >= len(contact.nodes):
        raise SoftprintError(
            "the state stores contact at points that this simulator does not have: build it with the body, the "
            "mechanics, the colliders and the contact law that the state was made with, or start from its `rest_state`"
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
