"""Check which BLAS is used, how fast it is, and with how many threads."""

from __future__ import annotations

import os

from softprint.runtime.doctor.child import run_python
from softprint.runtime.doctor.finding import Finding, Level

SLOW = 20.0  # GFLOP/s on one core: reference BLAS reaches about 5, an optimised one 30 to 100

# Multiplies two 1000 x 1000 matrices with one thread, best of three, and prints the shared library used.
_MEASURE = """
import time
import numpy as np
{setup}
a = np.asfortranarray(np.random.default_rng(0).random((1000, 1000)))
{multiply}
best = float("inf")
for _ in range(3):
    start = time.perf_counter()
    {multiply}
    best = min(best, time.perf_counter() - start)
names = {{line.split()[-1] for line in open("/proc/self/maps") if "/" in line}}
blas = sorted({{n.rsplit("/", 1)[1] for n in names if ".cpython" not in n and ({library})}})
print(f"{{2 / best:.1f}} {{', '.join(blas) or 'built in'}}")
"""

_NUMPY = {"setup": "", "multiply": "a @ a", "library": "'blas' in n.lower() or 'mkl' in n"}
_SYSTEM = {
    "setup": "from scipy.linalg.blas import dgemm",
    "multiply": "dgemm(1.0, a, a)",
    "library": "('blas' in n.lower() or 'mkl' in n) and '.libs/' not in n",
}


def check_numpy_blas() -> Finding:
    """The BLAS of numpy, used by reduced dynamics."""
    return _blas("BLAS of numpy", _NUMPY)


def check_scipy_blas() -> Finding:
    """The BLAS of scipy, on Debian also of PETSc, used by factorisations in full space."""
    return _blas("BLAS of scipy", _SYSTEM)


def _blas(subject: str, parts: dict[str, str]) -> Finding:
    result = run_python(_MEASURE.format(**parts), {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"})
    if not result.succeeded:
        return Finding(subject, Level.BROKEN, result.complaint, "see numpy and scipy above", needed=True)
    speed, library = result.output.split(maxsplit=1)
    detail = f"{speed} GFLOP/s on one core ({library})"
    if float(speed) < SLOW:
        optimised = any(name in library.lower() for name in ("openblas", "mkl", "blis"))
        remedy = "the machine is busy, or slow" if optimised else "apt-get install libopenblas0-serial"
        return Finding(subject, Level.WARN, detail, remedy)
    return Finding(subject, Level.OK, detail)


def check_threads() -> Finding:
    """Compare the number of threads with the number of cores."""
    cores = len(os.sched_getaffinity(0))
    threads = os.environ.get("OMP_NUM_THREADS")
    if threads is None:
        return Finding(
            "threads", Level.OK, f"{cores} cores; OMP_NUM_THREADS is not set, under mpirun set it to 1"
        )
    if not threads.isdigit() or int(threads) > cores:
        return Finding(
            "threads", Level.WARN, f"{cores} cores, OMP_NUM_THREADS={threads}", "more threads than cores"
        )
    return Finding("threads", Level.OK, f"{cores} cores, OMP_NUM_THREADS={threads}")
