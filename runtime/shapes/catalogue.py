"""The shapes by family, and the side of the split that each family is on."""

from __future__ import annotations

import difflib
from collections.abc import Mapping
from typing import Literal

from softprint.runtime.errors import SoftprintError
from softprint.runtime.shapes import testing_shapes as testing
from softprint.runtime.shapes import training_shapes as training
from softprint.runtime.shapes.scene_shapes import HAT
from softprint.runtime.shapes.shape import Shape

Side = Literal["train", "test"]
# The side of a shape, with those of the training side told apart that models are chosen by.
Role = Literal["train", "validation", "test"]

# Each family is on one side only, so that no testing shape is similar to a training shape.
SPLIT: Mapping[Side, Mapping[str, tuple[Shape, ...]]] = {
    "train": {
        "rounds": training.ROUNDS,
        "boxes": training.BOXES,
        "caltrops": training.CALTROPS,
        "gears": training.GEARS,
        "braille": training.BRAILLE,
        "minimal surfaces": training.MINIMAL,
        "stones": training.STONES,
        "sweeps": training.SWEEPS,
        "fruits": training.FRUITS,
    },
    "test": {
        "tori": testing.TORI,
        "screws": testing.SCREWS,
        "polyhedra": testing.POLYHEDRA,
        "vessels": testing.VESSELS,
        "brackets": testing.BRACKETS,
        "organics": testing.ORGANICS,
        "lattices": testing.LATTICES,
        "blobs": testing.BLOBS,
        "grounds": testing.GROUNDS,
    },
}
# Families of the training side that are used to select models; networks are trained on the others.
VALIDATION_FAMILIES = ("caltrops", "fruits")

SHAPES: Mapping[str, Shape] = {
    shape.name: shape for families in SPLIT.values() for shapes in families.values() for shape in shapes
}

# Further shapes for scenes; no model is trained or evaluated on these.
SCENE_SHAPES: Mapping[str, Shape] = {HAT.name: HAT}


def names(side: Side) -> list[str]:
    """The names of all shapes of a side, family by family."""
    return [shape.name for shapes in SPLIT[side].values() for shape in shapes]


def validation_names() -> list[str]:
    """Shapes of the training side that are left out of training when models are selected."""
    return [shape.name for family in VALIDATION_FAMILIES for shape in SPLIT["train"][family]]


def find_shape(name: str) -> Shape:
    """The shape of that name. Raises SoftprintError with the nearest name, or with all names."""
    known = {**SHAPES, **SCENE_SHAPES}
    if name not in known:
        near = difflib.get_close_matches(name, known, n=1)
        hint = f"did you mean '{near[0]}'?" if near else f"it has {', '.join(known)}"
        raise SoftprintError(f"the library has no shape '{name}'; {hint}")
    return known[name]
