"""The order of the house: imports point one way, and one module alone knows the version of DOLFINx."""

from __future__ import annotations

import ast
import subprocess
import sys
from pathlib import Path

import pytest

REPOSITORY = Path(__file__).resolve().parent.parent
PACKAGES = ("runtime", "surrogate", "fem_truth")
MAY_IMPORT = {"runtime": set(), "surrogate": {"runtime"}, "fem_truth": {"runtime"}}
FULL_SPACE_ONLY = {"dolfinx", "ufl", "basix", "ffcx", "petsc4py", "mpi4py"}
# Names that one of DOLFINx 0.5 and 0.9 has and the other has not, or has with another meaning.
VERSION_DEPENDENT = {
    "VectorFunctionSpace",
    "functionspace",
    "FunctionSpace",
    "gmshio",
    "create_vtk_mesh",
    "vtk_mesh",
}
LONGEST = 400  # lines


def modules(package: str) -> list[Path]:
    return sorted((REPOSITORY / package).rglob("*.py"))


def imported(tree: ast.AST) -> set[str]:
    """Top-level packages imported anywhere in a module, inside functions too."""
    names: set[str] = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            names |= {alias.name.partition(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"line {node.lineno}: imports here are absolute"
            names.add((node.module or "").partition(".")[0])
    return names


def violations(package: str, forbidden: set[str]) -> list[str]:
    return [
        f"{path.relative_to(REPOSITORY)} imports {name}"
        for path in modules(package)
        for name in sorted(imported(ast.parse(path.read_text())) & forbidden)
    ]


@pytest.mark.parametrize("package", PACKAGES)
def test_imports_point_one_way(package):
    assert violations(package, set(PACKAGES) - {package} - MAY_IMPORT[package]) == []


@pytest.mark.parametrize("package", ["runtime", "surrogate"])
def test_no_finite_elements_outside_the_truth(package):
    assert violations(package, FULL_SPACE_ONLY) == []


def test_one_module_knows_the_version_of_dolfinx():
    found = []
    for path in modules("fem_truth"):
        if path.name == "dolfinx_version.py":
            continue
        for node in ast.walk(ast.parse(path.read_text())):
            name = getattr(node, "attr", getattr(node, "id", ""))
            of_dolfinx = isinstance(node, ast.Attribute) and ast.unparse(node) == "dolfinx.__version__"
            if name in VERSION_DEPENDENT or of_dolfinx:
                found.append(f"{path.relative_to(REPOSITORY)}:{node.lineno} {name}")
    assert found == []


def test_runtime_loads_no_finite_elements():
    """Not even by way of a third library: imports every module of the runtime and looks at what came with
    it.
    """
    names = [
        ".".join(path.relative_to(REPOSITORY).with_suffix("").parts).removesuffix(".__init__")
        for path in modules("runtime")
        if path.name != "__main__.py"
    ]
    code = (
        f"import importlib, sys\nfor name in {names!r}: importlib.import_module(name)\n"
        f"print(sorted({FULL_SPACE_ONLY!r} & set(sys.modules)))"
    )
    result = subprocess.run(
        [sys.executable, "-c", code], cwd=REPOSITORY, capture_output=True, text=True, check=True
    )
    assert result.stdout.strip() == "[]"


@pytest.mark.parametrize("package", PACKAGES)
def test_modules_are_short_and_say_what_they_are(package):
    for path in modules(package):
        text = path.read_text()
        assert len(text.splitlines()) <= LONGEST, path
        if text.strip():
            assert ast.get_docstring(ast.parse(text)), f"{path} has no docstring"
