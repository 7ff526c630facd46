"""The files with compiled kernels that need a reference, and the kernels without one."""

from __future__ import annotations

import ast
from pathlib import Path

REPOSITORY = Path(__file__).resolve().parent.parent
_FOLDERS = ("body", "colliders", "elasticity", "linalg", "mesh", "rigid")
_FILES = (
    "runtime/contact/dents/dent_strain_kernels.py",
    "runtime/contact/piercing_kernels.py",
    "runtime/contact/point_kernels.py",
    "runtime/contact/stretched_gaps.py",
    "runtime/contact/carriers/rotation_kernels.py",
    "runtime/dynamics/terms/cell_group_blocks.py",
    "runtime/dynamics/terms/corner_gradients.py",
    "runtime/learned/internal/equilibrium/mode_kernels.py",
    "runtime/touch/raster_kernels.py",
    *(
        str(path.relative_to(REPOSITORY))
        for path in sorted((REPOSITORY / "runtime/mechanics").rglob("*_kernels.py"))
    ),
)
_COLLIDERS = "softprint.runtime.colliders."
#: Kernels that have no short reference, and why.
WITHOUT_REFERENCE = {
    _COLLIDERS + "cone_kernels.derivatives": "tested against finite differences of `values`, which has one",
    _COLLIDERS
    + "surface_mesh.sweep_kernels.mark_near": "control flow: which nodes are marked is free, but for those near",
    _COLLIDERS
    + "surface_mesh.sweep_kernels.sweep": "control flow: an order of visits; tested against exact distances",
    "softprint.runtime.mesh.nearest_facets._nearest": "a search; tested against libigl and winding numbers",
}


def kernels_of(path: Path) -> dict[str, tuple[bool, set[str]]]:
    """Kernel -> (whether it has a reference, the functions it calls)."""
    found = {}
    for node in ast.parse(path.read_text()).body:
        if not isinstance(node, ast.FunctionDef):
            continue
        for decorator in node.decorator_list:
            function = decorator.func if isinstance(decorator, ast.Call) else decorator
            if isinstance(function, ast.Name) and function.id in ("compiled", "summing"):
                calls = {
                    call.func.id
                    for call in ast.walk(node)
                    if isinstance(call, ast.Call) and isinstance(call.func, ast.Name)
                }
                found[node.name] = isinstance(decorator, ast.Call), calls
    return found


def _module(path: Path) -> str:
    return ".".join(("softprint", *path.relative_to(REPOSITORY).with_suffix("").parts))


_PATHS = [
    *(path for folder in _FOLDERS for path in sorted((REPOSITORY / "runtime" / folder).rglob("*.py"))),
    *(REPOSITORY / name for name in _FILES),
]
#: Module -> file, for all modules with kernels.
KERNEL_FILES = {_module(path): path for path in _PATHS if kernels_of(path)}
