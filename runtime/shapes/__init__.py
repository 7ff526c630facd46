"""The library: 52 solids made of formulas, 30 to train with and 22 to test with, in units of their own.

`shape = "library"` in an experiment makes colliders of them (`runtime/colliders/library.py`).
"""

from runtime.shapes.catalogue import SHAPES, SPLIT, find_shape, names, validation_names
from runtime.shapes.shape import Shape

__all__ = ["SHAPES", "SPLIT", "Shape", "find_shape", "names", "validation_names"]
