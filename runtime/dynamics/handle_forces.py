"""The generalised contact force of any model of contact at a given state, without dynamics: for reports and benchmarks.

It is the derivative by the handle rows, with the colliders held, of what contact adds to the energy: that of contact,
and where a correction displaces the body also what the correction changes in elasticity,

    h = dW_contact + dW_elastic(corrected) - dW_elastic(without colliders).
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

import numpy as np

from softprint.runtime.arrays import Array
from softprint.runtime.body.body import ReducedBody
from softprint.runtime.colliders.pose import Poses
from softprint.runtime.contact.penalty import PenaltyContact
from softprint.runtime.dynamics.kinematic import KinematicHandle, free_dofs
from softprint.runtime.dynamics.placed_collider import PlacedCollider, check_colliders
from softprint.runtime.dynamics.state import Configuration
from softprint.runtime.dynamics.step.body_terms import build_terms, find_corrections
from softprint.runtime.dynamics.step.evaluation import BodyEvaluation
from softprint.runtime.dynamics.timings import Timings
from softprint.runtime.mechanics.body_mechanics import BodyMechanics


class StaticContact:
    """The contact of a body with the colliders of a scene, state by state. The arguments are those of `Simulator`."""

    def __init__(
        self,
        body: ReducedBody,
        colliders: Sequence[PlacedCollider],
        contact: PenaltyContact,
        mechanics: BodyMechanics | None = None,
    ) -> None:
        check_colliders(colliders, body, mechanics, contact)
        corrections = find_corrections(body, colliders, mechanics, contact)
        self._terms = build_terms(body, colliders, corrections, mechanics, contact, None, np.zeros(body.dim))

    def handle_force(self, rows: Array, way: Sequence[Poses]) -> Array:
        """h (n_rows, dim) [N] at handle rows (n_rows, dim), with the colliders at the last of several poses; contact is
        followed along them. Every pose is a step, with a frame of its own: within one, sharp points of colliders press
        the same points of the body."""
        *_, last = self._followed(Configuration(rows, poses) for poses in way)
        return _handle_force(last)

    def along(self, motion: Iterable[Configuration]) -> Iterator[Array]:
        """h (n_rows, dim) [N] at each state of a motion; contact is followed from one to the next."""
        return map(_handle_force, self._followed(motion))

    def _followed(self, way: Iterable[Configuration]) -> Iterator[BodyEvaluation]:
        start = None
        for at in way:
            frame = self._terms.in_frame(at.rows)
            body = BodyEvaluation(frame, at, start, None, Timings())
            yield body
            start = None if body.contact is None else body.contact.warm_start


def _handle_force(body: BodyEvaluation) -> Array:
    """h at one state."""
    rows = body.at.rows
    force = body.surface.linearise(body.field, None, {}, len(rows))[0]
    if body.contact is not None:
        force = force + body.contact.gradient
    if body.frames is not None:
        force = force + body.frames.linearise({})[0]
    if body.field is not None:
        alone = body.frame.elastic.evaluate(rows, None).linearise(None)[0]
        force = force + body.elastic.linearise(body.field)[0] - alone
    return force


class HandleCoordinates:
    """The coordinates of the handles of a body that are solved for. held: the names of frames that are not."""

    def __init__(self, body: ReducedBody, held: set[str]) -> None:
        frames = [frame.name for frame in body.handles.frames if frame.name in held]
        self._handles = body.handles
        self._free = free_dofs(body.handles, [KinematicHandle(name) for name in frames])
        self._units = body.handles.units(0.5 * body.mesh.size)[self._free]

    def along(self, rows: Array, gradient: Array) -> Array:
        """(n_free,) [N] of a gradient (n_rows, dim) at handle rows; moments of frames by half the size of the body."""
        return np.asarray(self._handles.pulled_back(rows, gradient)[self._free] * self._units)
