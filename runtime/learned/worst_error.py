"""The error of a model on its worst sample, for tables of errors."""

from __future__ import annotations

import numpy as np

from softprint.runtime.arrays import Array

# Samples with less than this share of the mean squared displacement hardly touch; they are left out.
_TELLING = 0.01


def worst_relative_error(missed: Array, whole: Array) -> float:
    """The largest error of a sample, relative to its own displacement; of n samples with squared errors and squared
    displacements (n,), at least one, each summed over the nodes."""
    tells = whole >= _TELLING * whole.mean()
    return float(np.sqrt(missed[tells] / whole[tells]).max())
