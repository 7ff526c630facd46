"""Check whether MPI starts, h5py and DOLFINx work together, and forms can be compiled."""

from __future__ import annotations

import os
import shutil
import sys
import sysconfig
from importlib.util import find_spec
from pathlib import Path

from softprint.runtime.doctor.child import run_command, run_python
from softprint.runtime.doctor.finding import Finding, Level

_RANKS = "from mpi4py import MPI; print(MPI.COMM_WORLD.allreduce(1), MPI.Get_library_version().split(',')[0])"
# Open MPI runs as root only with both of these variables set.
ROOT = {"OMPI_ALLOW_RUN_AS_ROOT": "1", "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM": "1"}

_H5PY = """
import {first}, {second}
import h5py
with h5py.File("check.h5", "w", driver="core", backing_store=False) as file:
    file["x"] = [1.0, 2.0]
    assert list(file["x"][:]) == [1.0, 2.0]
"""


def check_mpi() -> Finding:
    """Run a sum over two ranks."""
    if find_spec("mpi4py") is None or shutil.which("mpirun") is None:
        remedy = "apt-get install python3-mpi4py openmpi-bin"
        return Finding("mpirun -n 2", Level.MISSING, "for generate on more than one core", remedy)
    command = ["mpirun", "--oversubscribe", "-n", "2", sys.executable, "-c", _RANKS]
    plain = run_command(command, {"OMP_NUM_THREADS": "1"})
    if plain.succeeded and plain.output.startswith("2"):
        return Finding("mpirun -n 2", Level.OK, plain.output.splitlines()[0][2:])
    found = run_command(command, {"OMP_NUM_THREADS": "1", **ROOT}) if os.getuid() == 0 else plain
    if found.succeeded and found.output.startswith("2"):
        remedy = f"as root, first: export {' '.join(f'{key}={value}' for key, value in ROOT.items())}"
        return Finding(
            "mpirun -n 2", Level.WARN, f"{found.output.splitlines()[0][2:]} refuses to run as root", remedy
        )
    return Finding(
        "mpirun -n 2", Level.BROKEN, found.complaint or found.output, "mpi4py and mpirun must be of one MPI"
    )


def check_h5py_beside_dolfinx() -> Finding:
    """Try both import orders: h5py's wheel contains its own HDF5, which crashes together with DOLFINx's."""
    subject = "h5py + dolfinx"
    if find_spec("dolfinx") is None or find_spec("h5py") is None:
        return Finding(subject, Level.OK, "not both installed")
    for first, second in (("h5py", "dolfinx"), ("dolfinx", "h5py")):
        result = run_python(_H5PY.format(first=first, second=second))
        if not result.succeeded:
            remedy = "use Debian's: pip uninstall h5py; apt-get install python3-h5py"
            return Finding(subject, Level.BROKEN, f"{first} first: {result.complaint}", remedy)
    return Finding(subject, Level.OK, "either may be imported first")


def check_compiler() -> Finding:
    """DOLFINx compiles each new form to C."""
    subject = "compiler for forms"
    if find_spec("dolfinx") is None:
        return Finding(subject, Level.OK, "not needed without DOLFINx")
    compiler = shutil.which(os.environ.get("CC", "cc")) or shutil.which("gcc")
    if compiler is None:
        return Finding(subject, Level.BROKEN, "there is no C compiler", "apt-get install gcc libc6-dev")
    header = Path(sysconfig.get_paths()["include"]) / "Python.h"
    if not header.is_file():
        return Finding(subject, Level.BROKEN, f"{header} is not there", "apt-get install python3-dev")
    return Finding(subject, Level.OK, compiler)
