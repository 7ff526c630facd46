"""The registry of materials: one file of this folder for each, named after its model.

To add one, write `NAME.py` here with a subclass of `Material` whose `model` is NAME, assigned to `MATERIAL`. Write the
same energy density in UFL, as the function NAME of `fem_truth.elasticity.energy_densities`. Schemas, messages, listed
keys and tests take the names from here. (A header `NAME.h` in `fem_truth/native` makes full-space solves
faster; without one, they use the UFL form.)
"""

from __future__ import annotations

from importlib import import_module
from pkgutil import iter_modules

from numpy.typing import ArrayLike

from softprint.runtime.elasticity.material import Material
from softprint.runtime.errors import SoftprintError

__all__ = ["MATERIALS", "Material", "make_material"]

#: The class of every material, by its model name.
MATERIALS: dict[str, type[Material]] = {
    module.name: import_module(f"{__name__}.{module.name}").MATERIAL for module in iter_modules(__path__)
}


def make_material(model: str, young: ArrayLike, poisson: ArrayLike) -> Material:
    """The material of that model name; young [Pa] and poisson are scalars or (n_cells,)."""
    if model not in MATERIALS:
        raise SoftprintError(f"material: unknown model {model!r}; known are {', '.join(MATERIALS)}")
    return MATERIALS[model].from_young_poisson(young, poisson)
