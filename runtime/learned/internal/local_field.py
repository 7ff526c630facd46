"""r of a correction as a function of the handle rows, at fixed nodes, with two derivatives: principal components, whose
coefficients are a network's, or quadratic in its inputs."""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from softprint.runtime.arrays import Array, IntArray
from softprint.runtime.lazy import lazy


class LocalPoint(Protocol):
    """r at n nodes and one state, with its derivatives by the handle rows."""

    @property
    def value(self) -> Array:
        """r (n, dim) [m] in the undeformed body."""
        ...

    def along(self, directions: Array | None) -> NDArray[np.floating[Any]]:
        """dr/drows (n, dim, k) along directions (n_rows*dim, k), by default every row and axis."""
        ...

    def pulled_back(self, forces: Array) -> Array:
        """sum_i f_i . dr_i/drows (n_rows*dim,) of forces (n, dim)."""
        ...

    def curvature(self, forces: Array, directions: Array | None) -> Array:
        """sum_i f_i . d2r_i/drows2 (k, k) between directions (n_rows*dim, k), by default every row and axis."""
        ...


class LocalField(Protocol):
    """r as a function of the handle rows, at fixed nodes."""

    def value(self, rows: Array) -> Array:
        """r (n, dim) [m] at handle rows (n_rows, dim)."""
        ...

    def at(self, rows: Array) -> LocalPoint:
        """r with its derivatives."""
        ...

    def some(self, index: IntArray) -> LocalField:
        """r at some of the nodes (m,)."""
        ...


class InputPoint(Protocol):
    """The inputs z of coefficients at one state, with their derivatives by the handle rows."""

    @property
    def value(self) -> Array:
        """z (n_inputs,)."""
        ...

    @property
    def derivative(self) -> Array:
        """dz/drows (n_inputs, n_rows*dim)."""
        ...

    def pulled_back(self, along: Array) -> Array:
        """d(a . z)/drows (n_rows*dim,) of a direction a (n_inputs,)."""
        ...

    def curvature(self, along: Array) -> Array:
        """d2(a . z)/drows2 (n_rows*dim, n_rows*dim) of a direction a (n_inputs,)."""
        ...


class Inputs(Protocol):
    """The inputs of coefficients as a function of the handle rows."""

    def __call__(self, rows: Array) -> Array: ...
    def at(self, rows: Array) -> InputPoint: ...


class MovedCoefficients(Protocol):
    """The derivatives of coefficients along k directions."""

    @property
    def slope(self) -> Array:
        """dc (count, k)."""
        ...

    def curvature(self, along: Array) -> Array:
        """d2(a . c) (k, k) between the directions, of a (count,)."""
        ...


class CoefficientsPoint(Protocol):
    """The coefficients at one input, with their derivatives."""

    @property
    def value(self) -> Array:
        """c (count,)."""
        ...

    def moved(self, directions: Array) -> MovedCoefficients:
        """Along directions (n_inputs, k)."""
        ...

    def pulled_back(self, along: Array) -> Array:
        """d(a . c)/dz (n_inputs,) of a direction a (count,)."""
        ...


class Coefficients(Protocol):
    """The coefficients of components as a function of the inputs: a `TanhNetwork` or a `QuadraticMap`."""

    def value(self, z: Array) -> Array: ...
    def at(self, z: Array) -> CoefficientsPoint: ...


class ModelField:
    """r of a trained model at some nodes."""

    def __init__(
        self, coefficients: Coefficients, modes: Array, inputs: Inputs, nodes: IntArray | None
    ) -> None:
        own = modes if nodes is None else modes[:, nodes]
        self.coefficients, self.inputs, self.shape = coefficients, inputs, own.shape
        self.modes = np.ascontiguousarray(own.reshape(len(own), -1))
        # Only the Hessian multiplies these: it gives Newton's method a direction, for which single precision is enough.
        self.by_node = np.ascontiguousarray(self.modes.T, dtype=np.float32)

    def reading(self, inputs: Inputs) -> ModelField:
        """The same with other inputs of its coefficients."""
        other = copy(self)
        other.inputs = inputs
        return other

    def some(self, index: IntArray) -> ModelField:
        """See `LocalField`."""
        other, (count, n, dim) = copy(self), self.shape
        other.shape = count, len(index), dim
        other.modes = np.ascontiguousarray(self.modes.reshape(count, n, dim)[:, index].reshape(count, -1))
        other.by_node = np.ascontiguousarray(self.by_node.reshape(n, dim, count)[index].reshape(-1, count))
        return other

    def value(self, rows: Array) -> Array:
        """See `LocalField`."""
        return np.asarray((self.coefficients.value(self.inputs(rows)) @ self.modes).reshape(self.shape[1:]))

    def at(self, rows: Array) -> ModelPoint:
        """See `LocalField`."""
        of_rows = self.inputs.at(rows)
        return ModelPoint(self, of_rows, self.coefficients.at(of_rows.value))


@dataclass(frozen=True, eq=False)
class ModelPoint:
    """A `LocalPoint` of a trained model."""

    field: ModelField
    inputs: InputPoint
    coefficients: CoefficientsPoint

    @lazy
    def value(self) -> Array:
        """See `LocalPoint`."""
        return np.asarray((self.coefficients.value @ self.field.modes).reshape(self.field.shape[1:]))

    @lazy
    def _computed(self) -> list[Moved]:
        """The last one: the same directions are asked for again."""
        return []

    def _moved(self, directions: Array | None) -> Moved:
        """The field along directions."""
        for known in self._computed:
            if known.directions is directions:
                return known
        of_inputs = self.inputs.derivative
        moved = self.coefficients.moved(of_inputs if directions is None else of_inputs @ directions)
        of_r = (self.field.by_node @ moved.slope.astype(np.float32)).reshape(*self.field.shape[1:], -1)
        self._computed[:] = [Moved(directions, moved, of_r)]
        return self._computed[0]

    def along(self, directions: Array | None) -> NDArray[np.float32]:
        """See `LocalPoint`."""
        return self._moved(directions).of_r

    def pulled_back(self, forces: Array) -> Array:
        """See `LocalPoint`."""
        return self.inputs.pulled_back(self.coefficients.pulled_back(self.field.modes @ forces.ravel()))

    def curvature(self, forces: Array, directions: Array | None) -> Array:
        """See `LocalPoint`."""
        a = self.field.modes @ forces.ravel()
        of_inputs = self.inputs.curvature(self.coefficients.pulled_back(a))
        if directions is not None:
            of_inputs = directions.T @ of_inputs @ directions
        return self._moved(directions).coefficients.curvature(a) + of_inputs


class Moved(NamedTuple):
    """A `ModelPoint` along directions (n_rows*dim, k), None for every row and axis: its coefficients, and r (n, dim,
    k)."""

    directions: Array | None
    coefficients: MovedCoefficients
    of_r: NDArray[np.float32]
