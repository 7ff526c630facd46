"""The structure of the code: the direction of imports, and a single module that depends on the version of DOLFINx."""

from __future__ import annotations

import ast
import re
import subprocess
import sys
from functools import cache
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

from tests.kernel_files import KERNEL_FILES, WITHOUT_REFERENCE, kernels_of

REPOSITORY = Path(__file__).resolve().parent.parent
PACKAGES = ("runtime", "surrogate", "fem_truth")
MAY_IMPORT = {"runtime": set(), "surrogate": {"runtime"}, "fem_truth": {"runtime"}}
FULL_SPACE_ONLY = {"dolfinx", "ufl", "basix", "ffcx", "petsc4py", "mpi4py"}
# Names that only one of DOLFINx 0.5 and 0.9 has, or that have different meanings.
VERSION_DEPENDENT = {
    "VectorFunctionSpace",
    "functionspace",
    "FunctionSpace",
    "gmshio",
    "create_vtk_mesh",
    "vtk_mesh",
}
LONGEST = 400  # lines
DEEPEST = 5  # levels of imports inside a folder
MOST = 16  # modules in a folder


def modules(package: str) -> list[Path]:
    return sorted((REPOSITORY / package).rglob("*.py"))


def imported(tree: ast.AST) -> set[str]:
    """Top-level packages imported anywhere in a module, inside functions too."""
    names: set[str] = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            names |= {package_of(alias.name) for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"line {node.lineno}: imports here are absolute"
            names |= {package_of(f"{node.module}.{alias.name}") for alias in node.names}
    return names


def package_of(name: str) -> str:
    """`runtime` of softprint.runtime.body, numpy of numpy.linalg."""
    first, _, rest = name.partition(".")
    return rest.partition(".")[0] if first == "softprint" else first


def violations(package: str, forbidden: set[str]) -> list[str]:
    return [
        f"{path.relative_to(REPOSITORY)} imports {name}"
        for path in modules(package)
        for name in sorted(imported(ast.parse(path.read_text())) & forbidden)
    ]


@pytest.mark.parametrize("package", PACKAGES)
def test_imports_have_one_direction(package):
    assert violations(package, set(PACKAGES) - {package} - MAY_IMPORT[package]) == []


@pytest.mark.parametrize("package", ["runtime", "surrogate"])
def test_no_finite_elements_outside_the_truth(package):
    assert violations(package, FULL_SPACE_ONLY) == []


def test_one_module_depends_on_the_version_of_dolfinx():
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
    """Not even through a third library: imports every module of the runtime and checks which modules are loaded."""
    names = [module_name(path) for path in modules("runtime") if path.name != "__main__.py"]
    code = (
        f"import importlib, sys\nfor name in {names!r}: importlib.import_module(name)\n"
        f"print(sorted({FULL_SPACE_ONLY!r} & set(sys.modules)))"
    )
    result = subprocess.run(
        [sys.executable, "-c", code], cwd=REPOSITORY, capture_output=True, text=True, check=True
    )
    assert result.stdout.strip() == "[]"


@pytest.mark.parametrize("package", PACKAGES)
def test_modules_are_short_and_have_docstrings(package):
    for path in modules(package):
        text = path.read_text()
        assert len(text.splitlines()) <= LONGEST, path
        if text.strip():
            assert ast.get_docstring(ast.parse(text)), f"{path} has no docstring"


def test_every_form_of_correction_has_the_same_files():
    """One folder here and one there with the same names inside, and one entry in the registry."""
    from softprint.runtime.learned.form import find_form
    from softprint.runtime.learned.registry import FORMS
    from softprint.surrogate.form import TrainingForm
    from softprint.surrogate.registry import TRAININGS

    for name in FORMS:
        assert find_form(name).name == name
        assert isinstance(TRAININGS[name], TrainingForm)
        for package, files in (
            ("runtime/learned", {"entry.py", "model.py", "inputs.py", "correction.py"}),
            ("surrogate", {"entry.py", "data.py", "loss.py", "task.py"}),
        ):
            assert files <= {path.name for path in (REPOSITORY / package / name).iterdir()}, (package, name)


def test_nothing_else_tells_forms_of_corrections_apart():
    from softprint.runtime.learned.registry import FORMS

    own = set(FORMS)
    chain = re.compile(r"\bform\s*(==|!=|in [(\[{])|== [A-Za-z_.]+\.form\b")
    found = [
        f"{path.relative_to(REPOSITORY)}: {line.strip()}"
        for folder in (*PACKAGES, "benchmarks", "reproduction")
        for path in modules(folder)
        if path.parent.name not in own
        for line in path.read_text().splitlines()
        if chain.search(line)
    ]
    assert found == []


def test_reading_an_experiment_loads_no_torch():
    code = (
        "import sys, softprint; softprint.load_experiment('examples/jelly_library.toml'); "
        "print('torch' in sys.modules)"
    )
    result = subprocess.run(
        [sys.executable, "-c", code], cwd=REPOSITORY, capture_output=True, text=True, check=True
    )
    assert result.stdout.strip() == "False"


def module_name(path: Path) -> str:
    parts = path.relative_to(REPOSITORY).with_suffix("").parts
    return ".".join(("softprint", *parts)).removesuffix(".__init__")


@cache
def import_graph() -> dict[str, set[str]]:
    """Module -> modules of the three packages that it imports: in functions and under TYPE_CHECKING too."""
    files = {module_name(path): path for package in PACKAGES for path in modules(package)}
    graph: dict[str, set[str]] = {}
    for name, path in files.items():
        found: set[str] = set()
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.Import):
                found |= {alias.name for alias in node.names}
            elif isinstance(node, ast.ImportFrom):
                parts = [f"{node.module}.{alias.name}" for alias in node.names]
                found |= {part if part in files else node.module or "" for part in parts}
        graph[name] = (found & set(files)) - {name}
    return graph


def levels(graph: dict[str, set[str]]) -> dict[str, int]:
    """Module -> length of the longest chain of imports that starts there. Raises CycleError if there is a cycle."""
    depth: dict[str, int] = {}
    for name in TopologicalSorter(graph).static_order():  # imported modules come first
        depth[name] = 1 + max((depth[other] for other in graph[name]), default=0)
    return depth


def test_no_modules_import_each_other():
    try:
        levels(import_graph())
    except CycleError as error:
        pytest.fail(f"these modules import each other: {' <- '.join(error.args[1])}")


def test_an_import_cycle_would_be_found():
    with pytest.raises(CycleError):
        levels({"a": {"b"}, "b": {"c"}, "c": {"a"}})


def test_imports_inside_a_folder_are_not_deep():
    graph, found = import_graph(), {}
    for package in PACKAGES:
        for folder in sorted({path.parent for path in modules(package)}):
            names = {module_name(path) for path in folder.glob("*.py") if path.name != "__init__.py"}
            if names:
                inside = {name: graph[name] & names for name in names}
                found[str(folder.relative_to(REPOSITORY))] = max(levels(inside).values())
    deep = {folder: depth for folder, depth in found.items() if depth > DEEPEST}
    assert deep == {}


def test_no_folder_has_many_modules():
    counts = {
        str(folder.relative_to(REPOSITORY)): len(
            [path for path in folder.glob("*.py") if path.stem != "__init__"]
        )
        for package in PACKAGES
        for folder in {path.parent for path in modules(package)}
    }
    assert {folder: count for folder, count in counts.items() if count > MOST} == {}


def test_compiled_kernels_have_a_reference():
    """Or are called by a kernel in the same file that has one, or are listed with a reason."""
    bare = set()
    for module, path in KERNEL_FILES.items():
        kernels = kernels_of(path)
        covered = {name for name, (referenced, _) in kernels.items() if referenced}
        while more := {call for name in covered for call in kernels[name][1] & set(kernels)} - covered:
            covered |= more
        bare |= {f"{module}.{name}" for name in set(kernels) - covered}
    # Functions called only by kernels without a reference, and by those that they call, need none.
    called, beyond = set(), set(WITHOUT_REFERENCE)
    while beyond:
        called |= beyond
        beyond = {
            f"{module}.{call}"
            for module, path in KERNEL_FILES.items()
            for name, (_, calls) in kernels_of(path).items()
            if f"{module}.{name}" in beyond
            for call in calls
        } - called
    called -= set(WITHOUT_REFERENCE)
    assert bare - called == set(WITHOUT_REFERENCE)


def test_softprint_is_the_one_import_name():
    """Its folders are links, so that an installation has no top-level package `runtime`."""
    for package in PACKAGES:
        assert (REPOSITORY / "softprint" / package).resolve() == REPOSITORY / package
    code = (
        "import sys, softprint; softprint.Simulator; "
        f"print(sorted({set(PACKAGES)!r} & set(sys.modules)), 'torch' in sys.modules)"
    )
    result = subprocess.run(
        [sys.executable, "-c", code], cwd=REPOSITORY, capture_output=True, text=True, check=True
    )
    assert result.stdout.split()[0] == "[]"


def test_every_public_name_exists():
    import softprint

    for name in softprint.__all__:
        assert getattr(softprint, name) is not None
    with pytest.raises(AttributeError, match="no attribute 'Nothing'"):
        _ = softprint.Nothing
