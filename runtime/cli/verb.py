"""The interface of command-line verbs. A verb module defines one `VERB`, registered in the entry points
`softprint.verbs`.

A verb module imports only light modules at its top, so that `softprint --help` stays fast; heavy or optional modules
are imported inside `run`.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from dataclasses import dataclass
from importlib.util import find_spec

from softprint.runtime.cli.context import Context

# How to install a missing module that a verb needs.
INSTALL = {
    "dolfinx": "DOLFINx (Debian: apt-get install python3-dolfinx)",
    "mpi4py": "mpi4py (Debian: apt-get install python3-mpi4py)",
    "h5py": "h5py (Debian: apt-get install python3-h5py)",
    "torch": "PyTorch (pip install torch)",
    "igl": "libigl (pip install libigl)",
    "pytetwild": "fTetWild (pip install 'softprint[new]')",
    "gmsh": "gmsh (pip install 'softprint[new]')",
    "pyvista": "PyVista (pip install 'softprint[report]')",
    "viser": "viser (pip install 'softprint[view]')",
}


@dataclass(frozen=True)
class Verb:
    """One step of the workflow.

    order: place in `softprint --help`; summary: one line; example: a complete command line;
    needs: modules without which the verb cannot run; configure: adds the verb's own options to its parser;
    run: does the work and returns the exit status; reads_experiment: whether it takes an experiment file and
    the options that go with one.
    """

    name: str
    order: int
    summary: str
    example: str
    run: Callable[[argparse.Namespace, Context], int]
    needs: tuple[str, ...] = ()
    configure: Callable[[argparse.ArgumentParser], None] = lambda parser: None
    reads_experiment: bool = True

    def missing(self) -> list[str]:
        """What must be installed before this verb can run; empty if it can."""
        return [INSTALL.get(module, module) for module in self.needs if find_spec(module) is None]
