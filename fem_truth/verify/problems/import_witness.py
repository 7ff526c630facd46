"""Imports the reference solver, which needs scikit-fem, with a clear error if that is not installed."""

from __future__ import annotations

from importlib import import_module
from importlib.util import find_spec
from typing import Any

from softprint.runtime.errors import SoftprintError


def import_witness() -> Any:
    """The module `fem_truth.verify.problems.witness`; raises SoftprintError if scikit-fem is missing."""
    if find_spec("skfem") is None:
        raise SoftprintError("this case needs scikit-fem, which is not installed: pip install scikit-fem")
    return import_module("softprint.fem_truth.verify.problems.witness")
