"""All checks, in the order in which they are shown."""

from __future__ import annotations

from collections.abc import Iterator

from runtime.doctor.finding import Finding
from runtime.doctor.graphics import check_rendering
from runtime.doctor.parallel import check_compiler, check_h5py_beside_dolfinx, check_mpi
from runtime.doctor.speed import check_numpy_blas, check_scipy_blas, check_threads
from runtime.doctor.versions import check_libraries, check_python


def examine() -> Iterator[Finding]:
    """What every check found, one after the other as they finish."""
    yield check_python()
    yield from check_libraries()
    yield check_numpy_blas()
    yield check_scipy_blas()
    yield check_threads()
    yield check_h5py_beside_dolfinx()
    yield check_mpi()
    yield check_compiler()
    yield check_rendering()
