"""Check which libraries are installed, in which versions, and what needs them."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from importlib.util import find_spec

from softprint.runtime.doctor.child import ChildResult, run_python
from softprint.runtime.doctor.finding import Finding, Level


@dataclass(frozen=True)
class Library:
    """module: import name; purpose: what it is for; remedy: how to install it; version: code that returns the
    version."""

    module: str
    purpose: str
    remedy: str
    needed: bool = False
    version: str = "module.__version__"


def _pip(name: str) -> str:
    return f"pip install {name}"


LIBRARIES = (
    Library("numpy", "arrays", _pip("numpy"), needed=True),
    Library("scipy", "splines and rotations", _pip("scipy"), needed=True),
    Library("numba", "kernels of contact", _pip("numba"), needed=True),
    Library("pydantic", "experiment files", _pip("pydantic"), needed=True),
    Library(
        "h5py",
        "body, truth and motion files",
        "apt-get install python3-h5py",
        needed=True,
        version="f'{module.__version__} (HDF5 {module.version.hdf5_version})'",
    ),
    Library("meshio", "reading meshes", _pip("meshio"), needed=True),
    Library("igl", "the subspace basis", _pip("libigl"), needed=True, version="metadata.version('libigl')"),
    Library("trimesh", "mesh colliders", _pip("trimesh"), needed=True),
    Library("torch", "learned corrections", _pip("torch"), needed=True),
    Library("safetensors", "correction files", _pip("safetensors"), needed=True),
    Library("tqdm", "progress bars", _pip("tqdm"), needed=True),
    Library(
        "dolfinx",
        "generate, report, the full-space model",
        "apt-get install python3-dolfinx",
        version="metadata.version('fenics-dolfinx')",
    ),
    Library("petsc4py", "generate", "apt-get install python3-petsc4py"),
    Library("mpi4py", "generate", "apt-get install python3-mpi4py openmpi-bin"),
    Library("pyvista", "pictures in the report", _pip("pyvista")),
    Library("matplotlib", "figures in the report", _pip("matplotlib")),
    Library("jinja2", "the report", _pip("jinja2"), version="metadata.version('jinja2')"),
    Library("viser", "the window of softprint view", _pip("viser==1.1.1")),
    Library("gmsh", "making the example meshes", _pip("gmsh")),
)


def check_python() -> Finding:
    """The Python version."""
    version = ".".join(str(part) for part in sys.version_info[:3])
    return Finding("python", Level.OK, f"{version} ({sys.executable})")


def check_libraries() -> Iterator[Finding]:
    """Every library: whether it is installed and can be imported."""
    present = [library for library in LIBRARIES if find_spec(library.module) is not None]
    with ThreadPoolExecutor(max_workers=2) as pool:
        results = dict(zip(present, pool.map(_imported, present), strict=True))
    for library in LIBRARIES:
        if library not in results:
            yield Finding(
                library.module, Level.MISSING, f"for {library.purpose}", library.remedy, needed=library.needed
            )
        elif results[library].succeeded:
            yield Finding(library.module, Level.OK, results[library].output.splitlines()[-1])
        else:
            yield Finding(
                library.module, Level.BROKEN, results[library].complaint, f"again: {library.remedy}"
            )


def _imported(library: Library) -> ChildResult:
    return run_python(
        f"from importlib import metadata\nimport {library.module} as module\nprint({library.version})"
    )
