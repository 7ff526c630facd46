"""The library: 52 solids given by formulas, 30 for training and 22 for testing, in their own units; a hat for scenes.

`shape = "library"` in an experiment makes them colliders (`runtime/colliders/library.py`).
"""

from softprint.runtime.shapes.catalogue import (
    SCENE_SHAPES,
    SHAPES,
    SPLIT,
    find_shape,
    names,
    validation_names,
)
from softprint.runtime.shapes.shape import Shape

__all__ = ["SCENE_SHAPES", "SHAPES", "SPLIT", "Shape", "find_shape", "names", "validation_names"]
