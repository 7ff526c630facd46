"""The energy whose minimum is the next state (thesis eqs. 4.5 and 5.5).

    E(rows) = 1/(2 h^2) tr((rows - rows*)^T M (rows - rows*)) - tr(weight^T rows) + springs   (quadratic)
            + W_elastic(rows) + W_contact(rows) + friction(rows),   rows* = rows_old + h rows_velocity_old,

M = U^T diag(node_mass) U. W_contact is penalty at the (corrected) surface samples, or, for a collider whose
correction brings it, the energy with the detail condensed out (`condensed_contact.py`). Corrections are
quasi-static: they carry neither inertia nor weight. The internal response, where there is one, has no inertia
either, but it has weight. The rotations of the body that it follows, its turn, are those of the start of the
step. Newton's unknowns are the free minimal coordinates v of `Handles.retract`; with T = d rows/dv the chain
rule is

    gradient = T^T dE/drows,    Hessian = T^T (d2E/drows2) T + curvature of the retraction.

Colliders that move freely bring their twists as further unknowns, and their own inertia, weight and contacts
(`free_bodies.py`).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from runtime.arrays import Array, IntArray, known_hessian
from runtime.body.handles import Handles
from runtime.contact.condensed.condensed_contact import CondensedContact
from runtime.contact.contact_force import ContactForce
from runtime.contact.friction_state import FrictionState
from runtime.dynamics.corrected_points import CorrectedPoints
from runtime.dynamics.free_bodies import FreeStep
from runtime.dynamics.newton import Linearisation
from runtime.dynamics.state import Configuration
from runtime.dynamics.terms.elastic import Elastic
from runtime.dynamics.terms.springs import QuadraticForm
from runtime.dynamics.terms.surface_contact import SurfaceContactEnergy
from runtime.dynamics.timings import Timings
from runtime.learned.correction import CorrectionField

# Energies are sums of some thousand float64 terms: differences below this share of their size are round-off.
_ROUND_OFF = 1e-13
# The same for what networks in float32 take part in.
_SINGLE_ROUND_OFF = 1e-8


class Evaluation(NamedTuple):
    """What the energy found at a configuration: corrected surface samples (s, dim) [m] and elastic energy [J]."""

    at: Configuration
    surface: Array
    elastic: float


class StepEnergy:
    """A `newton.Problem` over handle rows and poses, for one step.

    quadratic: inertia, gravity and springs; turn: (n_rows, dim), see `corotation.py`; step: what
    friction remembers, None where there is none; free_colliders: those that are solved for, None where all of them
    stand where they are told;
    friction_updates: how many linearisations take up new normal forces for friction before these are frozen
    so that Newton can converge. force_floor [N]: forces below it are nothing; units (n_free,): 1 for lengths,
    1/lever [1/m] for angles, so that all unknowns are metres and all gradients newtons.
    """

    def __init__(
        self,
        *,
        handles: Handles,
        free: IntArray,
        quadratic: QuadraticForm,
        points: CorrectedPoints,
        elastic: Elastic,
        surface: SurfaceContactEnergy,
        condensed: CondensedContact,
        turn: Array,
        step: FrictionState | None,
        free_colliders: FreeStep | None = None,
        friction_updates: int,
        force_floor: float,
        units: Array,
        timings: Timings,
    ) -> None:
        self._handles = handles
        self._free = free
        self._quadratic = quadratic
        self._points = points
        self._elastic = elastic
        self._surface = surface
        self._condensed = condensed
        self._colliders = free_colliders
        self.turn = turn
        self._step = step
        self._relags_left = friction_updates
        self._force_floor = force_floor
        self._units = units
        self._timings = timings
        self._latest: Evaluation | None = None
        # The forces of contact (n_free,) [N] that the last linearisation found; None where contact is more than a
        # function of the body's state: with friction, colliders that are unknowns, or fields that move points.
        self.contact_seen: Array | None = None
        self._blocks = _by_axis(quadratic.matrix, handles.dim)
        # Where all handles are free points, the unknowns are the rows themselves.
        self._all_free = len(free) == handles.n_dofs
        self._straight = not handles.frames and self._all_free

    def retract(self, x: Configuration, v: Array) -> Configuration:
        """After the increment v (n_free + twists,) of the free coordinates and of the free colliders."""
        increment, own = np.zeros(self._handles.n_dofs), len(self._free)
        increment[self._free] = v[:own] * self._units
        rows = self._handles.retract(x.rows, increment)
        if self._colliders is None:
            return Configuration(rows, x.poses)
        return Configuration(rows, self._colliders.movers.retract(x.poses, v[own:]))

    def longest(self, x: Configuration, v: Array) -> float:
        """All of it, but that free colliders do not pass through anything."""
        return 1.0 if self._colliders is None else self._colliders.longest(x, v[len(self._free) :])

    def energy(self, x: Configuration) -> float:
        """E [J], friction lagged as at the last `linearise`."""
        found = self.evaluate(x)
        with self._timings.contact:
            contact = self._surface.energy(found.surface, x.poses, self._step)
            contact += self._condensed.energy(x.rows, x.poses, self.turn, self._step)
            if self._colliders is not None:
                contact += self._colliders.energy(x.poses)
        return self._quadratic.energy(x.rows) + found.elastic + contact

    def evaluate(self, x: Configuration) -> Evaluation:
        """The evaluation at x, remembered if it is that of the last one.

        A line search ends with the point it accepts, so the end of a step is not evaluated again. Where nothing is
        corrected, other poses change nothing.
        """
        latest, rows = self._latest, x.rows
        if latest is not None and latest.at.rows is rows and not self._points.corrected:
            self._latest = latest._replace(at=x)
        elif latest is None or latest.at is not x:
            displacement = self._points.displacement(rows, x.poses, self._timings.correction)
            with self._timings.positions:
                surface = self._surface.positions(rows, self.turn, displacement)
            with self._timings.elastic:
                elastic = self._elastic.energy(rows, self.turn, displacement)
            self._latest = Evaluation(x, surface, elastic)
        assert self._latest is not None
        return self._latest

    def _surface_at(self, x: Configuration, field: CorrectionField | None) -> Array:
        """Not anew where an evaluation has just found it."""
        if field is None and self._latest is not None and self._latest.at is x:
            return self._latest.surface
        return self._surface.positions(x.rows, self.turn, self._points.scatter(field))

    def slope(self, x: Configuration, contact: Array) -> Array:
        """The gradient (n_free,) [N] at x, but that contact is what it was elsewhere (n_free,). Of the body alone."""
        with self._timings.elastic:
            _, elastic, _ = self._elastic.linearise(x.rows, self.turn, None)
        with self._timings.solve:
            return self._pulled_back(x.rows, self._quadratic.gradient(x.rows) + elastic) + contact

    def _tangent(self, rows: Array) -> Array:
        """T (n_rows*dim, n_free)."""
        tangent = self._handles.tangent(rows)
        return (tangent if self._all_free else tangent[:, self._free]) * self._units

    def _pulled_back(self, rows: Array, gradient: Array) -> Array:
        """T^T dE/drows (n_free,)."""
        by_dofs = self._handles.pulled_back(rows, gradient)
        return (by_dofs if self._all_free else by_dofs[self._free]) * self._units

    def contacts(self, at: Evaluation) -> tuple[float, float, dict[str, ContactForce]]:
        """Contact energy and friction energy [J], those among colliders too; the force of the body on each
        collider."""
        with self._timings.contact:
            rows, poses = at.at
            normal, friction, forces = self._surface.forces(at.surface, poses, self._step)
            condensed = self._condensed.forces(rows, poses, self.turn, self._step)
            among = (0.0, 0.0)
            if self._colliders is not None:
                among = self._colliders.among(poses)
        return (
            normal + condensed[0] + among[0],
            friction + condensed[1] + among[1],
            {**forces, **condensed[2]},
        )

    def linearise(self, x: Configuration) -> Linearisation:
        """E, gradient [N] and Hessian [N/m]; the scale is the largest of the forces that balance one
        another."""
        rows, poses = x
        field = self._points.linearise(rows, poses, self._timings.correction)
        with self._timings.positions:
            surface = self._surface_at(x, field)
        with self._timings.elastic:
            elastic, elastic_gradient, elastic_hessian = self._elastic.linearise(rows, self.turn, field)
        with self._timings.contact:
            relag = self._relags_left > 0
            centres = {} if self._colliders is None else self._colliders.movers.centres(poses)
            contact, contact_gradient, contact_hessian, couplings = self._surface.linearise(
                surface, self.turn, field, poses, self._step, relag, centres
            )
            condensed, condensed_gradient, condensed_hessians = self._condensed.linearise(
                rows, poses, self.turn, self._step, relag
            )
            more, links = self._condensed.couplings(rows, poses, self.turn, centres, self._step)
            contact, contact_gradient = contact + condensed, contact_gradient + condensed_gradient
        self._latest = Evaluation(x, surface, elastic)
        with self._timings.solve:
            quadratic_gradient = self._quadratic.gradient(rows)
            gradients = quadratic_gradient, elastic_gradient, contact_gradient
            parts = [self._pulled_back(rows, part) for part in gradients]
            slope = quadratic_gradient + elastic_gradient + contact_gradient

        if self._step is None and self._colliders is None and not self._points.corrected:
            self.contact_seen = parts[2]

        def hessian() -> Array:
            with self._timings.solve:
                along = None if self._straight else self._tangent(rows)
                curvature = self._handles.curvature(rows, slope)[np.ix_(self._free, self._free)]
                by_rows = self._blocks if contact_hessian is None else self._blocks + contact_hessian
                total = known_hessian(by_rows)(along) + self._units[:, None] * curvature * self._units
            with self._timings.elastic:
                total += elastic_hessian(along)
            with self._timings.contact:
                for condensed_hessian in condensed_hessians:
                    total += condensed_hessian(along)
            return total

        quadratic = self._quadratic.energy(rows)
        found = Linearisation(
            energy=quadratic + elastic + contact,
            noise=_ROUND_OFF * (abs(self._quadratic.constant) + abs(quadratic))
            + (_SINGLE_ROUND_OFF if self._points.corrected else _ROUND_OFF) * (elastic + contact),
            gradient=parts[0] + parts[1] + parts[2],
            second_derivative=hessian,
            scale=max(*(float(np.linalg.norm(part)) for part in parts), self._force_floor),
        )
        if self._colliders is not None:
            found = self._colliders.joined(
                found, poses, [*couplings, *more], links, self._tangent(rows), relag, self._timings
            )
        self._relags_left -= 1
        return found


def _by_axis(matrix: Array, dim: int) -> Array:
    """matrix (x) I (n*dim, n*dim) of a matrix (n, n) that acts on every axis alike."""
    n = len(matrix)
    blocks = np.zeros((n, dim, n, dim))
    for axis in range(dim):
        blocks[:, axis, :, axis] = matrix
    return blocks.reshape(n * dim, n * dim)
