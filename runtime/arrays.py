"""The array types of the reduced mechanics, the sum that all of it scatters with, and how it tells a state again."""

from collections.abc import Callable
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from softprint.runtime.compiled import compiled
from softprint.runtime.linalg.sparse_directions import between_directions

Array = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]

# A Hessian that is computed when it is called: an iteration that finds the forces in balance needs none.
Hessian = Callable[[], Array]


class RowHessian(Protocol):
    """The same by the handle rows, H (n, n). along: T (n, k), directions of which alone it is wanted, as T^T H T; there
    are fewer of them than rows where handles are rigid or held."""

    def __call__(self, along: Array | None = None) -> Array: ...


def known_hessian(hessian: Array) -> RowHessian:
    """Of a matrix (n, n) that is there."""
    return lambda along=None: hessian if along is None else between_directions(hessian, along)


@compiled
def same(one: NDArray[Any], other: NDArray[Any]) -> bool:
    """`np.array_equal` of small arrays of as many axes, at a fraction of its cost."""
    if one.shape != other.shape:
        return False
    a, b, alike = one.ravel(), other.ravel(), True
    for i in range(len(a)):
        alike = alike and a[i] == b[i]
    return alike


def scatter_sum(index: IntArray, values: Array, size: int) -> Array:
    """(size,) sums of the values by index; both are flattened."""
    return np.asarray(np.bincount(index.ravel(), weights=values.ravel(), minlength=size), dtype=np.float64)
