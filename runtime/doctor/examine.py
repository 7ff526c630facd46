"""All checks, in the order of the report."""

from __future__ import annotations

from collections.abc import Iterator

from softprint.runtime.doctor.finding import Finding
from softprint.runtime.doctor.graphics import check_rendering
from softprint.runtime.doctor.parallel import check_compiler, check_h5py_beside_dolfinx, check_mpi
from softprint.runtime.doctor.speed import check_numpy_blas, check_scipy_blas, check_threads
from softprint.runtime.doctor.versions import check_libraries, check_python


def examine() -> Iterator[Finding]:
    """The findings of all checks, one by one as they finish."""
    yield check_python()
    yield from check_libraries()
    yield check_numpy_blas()
    yield check_scipy_blas()
    yield check_threads()
    yield check_h5py_beside_dolfinx()
    yield check_mpi()
    yield check_compiler()
    yield check_rendering()
