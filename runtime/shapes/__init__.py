"""The library: 52 solids made of formulas, 30 to train with and 22 to test with, in their own units; a hat for scenes.

`shape = "library"` in an experiment makes colliders of them (`runtime/colliders/library.py`).
"""

from runtime.shapes.catalogue import SCENE_SHAPES, SHAPES, SPLIT, find_shape, names, validation_names
from runtime.shapes.shape import Shape

__all__ = ["SCENE_SHAPES", "SHAPES", "SPLIT", "Shape", "find_shape", "names", "validation_names"]
