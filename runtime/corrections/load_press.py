"""The contact of a reduced state as mechanics alone gives it, and how it changes with the state.

Loads near the collider are pressed by `load_solve.py` at their positions x(q), internal response included. With
f = p g the forces in balance, D their stiffening in rest coordinates, and dxi = dx + dF v the motion of a load that
keeps its displacement v,

    dv  = G (dF^T f + F^T df),    (I + G D) w = F^-1 dxi + G dF^T f =: C,    F^T df = -D w,    dy = F w.

So the energy W(q) of contact and dent together has (Clapeyron's theorem, envelope theorem)

    dW  = -sum_j f_j . dxi_j,
    d2W = C^T D (I + G D)^-1 C - (dF^T f)^T G (dF^T f),

both exact: no derivative beyond the Hessian of the distance is needed, for x and F are affine in the handle rows while
the body's turn is held.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from runtime.arrays import Array, IntArray
from runtime.body.body import ReducedBody
from runtime.colliders.collider import Collider, SdfDerivatives
from runtime.colliders.pose import RigidPose
from runtime.corrections.load_solve import LoadProblem, LoadSolution
from runtime.corrections.rest_mechanics import RestMechanics

# Loads outside the collider by up to this share of its depth could be pushed into it by the dent beside them. In
# measured contacts none of those beyond 0.05 ever was.
_ROOM = 0.25


@dataclass(frozen=True, eq=False)
class PosedDistance:
    """The signed distance of a collider in the world."""

    collider: Collider
    pose: RigidPose

    def __call__(self, x: Array) -> SdfDerivatives:
        value, gradient, hessian = self.collider.sdf_derivatives(self.pose.apply_inverse(x))
        return SdfDerivatives(value, self.pose.rotate(gradient), self.pose.rotate_matrices(hessian))


@dataclass(frozen=True, eq=False)
class LoadMotion:
    """How k loads move with the R = n_rows * dim handle rows: of their positions dx (k, dim, R) and of F, through the
    gradients of the basis (k, n_rows, dim)."""

    position: Array
    basis_gradient: Array

    def carried(self, given: Array) -> Array:
        """dx + dF v (k, dim, R) for v = given (k, dim)."""
        k, dim, _ = self.position.shape
        moved = self.position.reshape(k, dim, -1, dim).copy()
        turned = (self.basis_gradient @ given[..., None])[..., 0]
        for axis in range(dim):
            moved[:, axis, :, axis] += turned
        return moved.reshape(k, dim, -1)

    def turned(self, force: Array) -> Array:
        """dF^T f (k, dim, R) for f = force (k, dim)."""
        k, dim = force.shape
        return (self.basis_gradient.transpose(0, 2, 1)[..., None] * force[:, None, None, :]).reshape(
            k, dim, -1
        )


@dataclass(frozen=True, eq=False)
class LoadPress:
    """rows, pose: of the state; positions: x (n_loads, dim) [m] of all loads; around: those within the band around the
    collider; index: (m,) those of them that could bear pressure; for these the problem and its solution."""

    rows: Array
    pose: RigidPose
    positions: Array
    around: IntArray
    index: IntArray
    problem: LoadProblem
    solution: LoadSolution
    motion: LoadMotion

    def predict(self, rows: Array, pose: RigidPose, index: IntArray) -> tuple[Array, Array] | None:
        """Penetrations (m,) and normals (m, dim) of the loads `index` at a state nearby, to first order, where they
        bear pressure here; None for a state too far away. With dc what the collider carries a load along by,

            dr = F (I + G D)^-1 [F^-1 (dxi - dc) + G dF^T f],    de = -g . dr,    dg = H dr, turned with the collider.
        """
        b, solution, F = self.bearing, self.solution, self.problem.F[self.bearing]
        if not b.size:
            return None
        dq = (rows - self.rows).ravel()
        y = self.problem.position[b] + solution.moved[b]
        apart = self.carried @ dq - (pose.apply(self.pose.apply_inverse(y)) - y)
        if np.abs(apart).max() > self.problem.depth:
            return None
        pull = np.linalg.solve(F, apart[..., None]).ravel() + self._among @ (self._turned @ dq).ravel()
        dr = F @ np.linalg.solve(self._softening, pull).reshape(*apart.shape, 1)
        g = solution.normal[b]
        # A load that is about to let go keeps a little, so that Newton's method sees it.
        e = np.maximum(solution.left[b] - (g * dr[..., 0]).sum(axis=1), 0.1 * solution.left[b])
        turned = (g + (solution.curvature[b] @ dr)[..., 0]) @ (pose.rotation @ self.pose.rotation.T).T
        left, normal = np.full(len(index), -np.inf), np.zeros((len(index), len(turned[0])))
        _, there, here = np.intersect1d(index, self.index[b], assume_unique=True, return_indices=True)
        left[there], normal[there] = e[here], turned[here]
        return left, normal

    @cached_property
    def bearing(self) -> IntArray:
        """(k,) which of the m bear pressure."""
        return np.flatnonzero(self.solution.pressure > 0.0)

    @property
    def load(self) -> Array:
        """F^T f (k, dim) [N] of those that do."""
        b = self.bearing
        return np.asarray((self.problem.F[b].transpose(0, 2, 1) @ self.solution.force[b][..., None])[..., 0])

    @property
    def gradient(self) -> Array:
        """dW/drows (R,) [N]."""
        b = self.bearing
        moved = self.carried
        return -(self.solution.force[b].ravel() @ moved.reshape(-1, moved.shape[2]))

    @property
    def hessian(self) -> Array:
        """d2W/drows2 (R, R) [N/m]."""
        turned = self._turned.reshape(self._pull.shape)
        return self._pull.T @ self._stiffened - turned.T @ (self._among @ turned)

    @cached_property
    def carried(self) -> Array:
        """dx + dF v (k, dim, R) of the loads that bear pressure: how they move with their displacement v held."""
        return self._motion.carried(self.solution.given[self.bearing])

    @cached_property
    def _motion(self) -> LoadMotion:
        b = self.bearing
        return LoadMotion(self.motion.position[b], self.motion.basis_gradient[b])

    @cached_property
    def _turned(self) -> Array:
        return self._motion.turned(self.solution.force[self.bearing])

    @cached_property
    def _among(self) -> Array:
        return self.problem.among(self.bearing)

    @cached_property
    def _blocks(self) -> Array:
        return self.problem.stiffening(self.solution, self.bearing)

    @cached_property
    def _pull(self) -> Array:
        """C (k*dim, R)."""
        b, carried = self.bearing, self.carried
        turned = self._turned.reshape(-1, carried.shape[2])
        back: Array = np.linalg.solve(self.problem.F[b], carried)
        return np.asarray(back.reshape(turned.shape) + self._among @ turned)

    @cached_property
    def _answer(self) -> Array:
        """w = F^-1 dy (k*dim, R)."""
        return np.linalg.solve(self._softening, self._pull)

    @cached_property
    def _softening(self) -> Array:
        """I + G D (k*dim, k*dim)."""
        return self.problem.softening(self.bearing, self._blocks)

    @cached_property
    def _stiffened(self) -> Array:
        """D w (k*dim, R)."""
        k, dim, _ = self._blocks.shape
        return (self._blocks @ self._answer.reshape(k, dim, -1)).reshape(k * dim, -1)


class LoadProbe:
    """Presses the loads of one body against one collider. stiffness: of the penalty contact [N/m^4]; band: [m], of
    loads around the collider that others ask for."""

    def __init__(
        self,
        body: ReducedBody,
        collider: Collider,
        mechanics: RestMechanics,
        stiffness: float,
        band: float = 0.0,
    ) -> None:
        compliance, internal = mechanics
        points = body.node_points(compliance.nodes)
        self.collider = collider
        self.among_loads = compliance.among_loads()
        self.points = points
        self.internal = None if internal is None else internal.at(compliance.nodes)
        self._stiffness, self._band = stiffness * compliance.areas, band
        self._last: tuple[Array, RigidPose, Array, LoadPress | None] | None = None

    def turn(self, rows: Array) -> Array:
        """Of the body at handle rows, see `InternalResponse.turn`; the identity where there is none."""
        return np.eye(rows.shape[1]) if self.internal is None else self.internal.turn(rows)

    def positions(self, rows: Array, turn: Array) -> Array:
        """x (n_loads, dim) [m], internal response included."""
        x = self.points.basis @ rows
        return x if self.internal is None else x + self.internal.displacement(rows, turn)

    def _near(self, x: Array, pose: RigidPose, distance: float) -> tuple[IntArray, Array]:
        """The loads at positions x (n_loads, dim) that are closer to the collider than `distance` [m], and their
        signed distance."""
        z = pose.apply_inverse(x)
        collider = self.collider
        within = ((z > collider.lower - distance) & (z < collider.upper + distance)).all(axis=1)
        index = np.flatnonzero(within)
        value = collider.sdf(z[index])
        close = value < distance
        return index[close], value[close]

    def press(self, rows: Array, pose: RigidPose, turn: Array) -> LoadPress | None:
        """The loads in balance at handle rows (n_rows, dim), or None where none is inside the collider. The last
        answer is kept: dynamics asks for energy, derivatives and forces of one state one after the other."""
        near = None
        if self._last is not None:
            last_rows, last_pose, last_turn, near = self._last
            if last_pose is pose and last_turn is turn and np.array_equal(last_rows, rows):
                return near
        press = self._press(rows, pose, turn, near)
        self._last = (rows.copy(), pose, turn, press)
        return press

    def _press(self, rows: Array, pose: RigidPose, turn: Array, near: LoadPress | None) -> LoadPress | None:
        x = self.positions(rows, turn)
        around, distance = self._near(x, pose, self._band)
        depth = -float(distance.min(initial=0.0))
        if depth <= 0.0:
            return None
        if _ROOM * depth > self._band:
            around, distance = self._near(x, pose, _ROOM * depth)
        index = around[distance < _ROOM * depth]
        problem = LoadProblem(
            self.among(index, index),
            self._stiffness[index],
            x[index],
            self.deformation(rows, index),
            depth,
            PosedDistance(self.collider, pose),
        )
        start = None if near is None else near.predict(rows, pose, index)
        return LoadPress(
            rows.copy(), pose, x, around, index, problem, problem.solve(start), self.motion(index, turn)
        )

    def settled(self, rows: Array, pose: RigidPose, turn: Array) -> Callable[[IntArray], Array]:
        """y = x + F v (m, dim) [m] of any loads (m,) at handle rows (n_rows, dim)."""
        press = self.press(rows, pose, turn)
        if press is None:
            return self.positions(rows, turn).__getitem__
        bearing, load = press.index[press.bearing], press.load

        def positions(index: IntArray) -> Array:
            given = np.tensordot(self.among(index, bearing), load, 2)
            moved = self.deformation(rows, index) @ given[..., None]
            return np.asarray(press.positions[index] + moved[..., 0])

        return positions

    def among(self, index: IntArray, loads: IntArray) -> Array:
        """G (len(index), dim, len(loads), dim) [m/N] at the loads `index` by forces on others."""
        pairs = self.among_loads[index[:, None], loads].astype(np.float64)
        return np.ascontiguousarray(pairs.transpose(0, 2, 1, 3))

    def deformation(self, rows: Array, index: IntArray) -> Array:
        """F (m, dim, dim)."""
        return np.asarray(rows.T @ self.points.basis_gradient[index])

    def motion(self, index: IntArray, turn: Array) -> LoadMotion:
        """How the loads `index` move with the handle rows."""
        basis = self.points.basis[index]
        dim = turn.shape[0]
        moved = (basis[:, None, :, None] * np.eye(dim)[:, None, :]).reshape(len(index), dim, -1)
        if self.internal is not None:
            moved += self.internal.derivative(turn, index).reshape(moved.shape)
        return LoadMotion(moved, self.points.basis_gradient[index])
