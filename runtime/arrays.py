"""The array types of the reduced mechanics, and the one sum that all of it scatters with."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]

# A Hessian for whoever asks: where forces are found to balance, nobody does.
Hessian = Callable[[], Array]


def scatter_sum(index: IntArray, values: Array, size: int) -> Array:
    """(size,) sums of the values by index; both are flattened."""
    return np.asarray(np.bincount(index.ravel(), weights=values.ravel(), minlength=size), dtype=np.float64)
