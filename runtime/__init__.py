"""Softprint's runtime: reduced soft bodies, colliders, learned corrections and their dynamics in real time.

    from runtime import load_body, load_experiment

Names are imported from their modules on first use, so `import runtime` is quick.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from runtime.errors import SoftprintError

if TYPE_CHECKING:
    from runtime.body import ReducedBody, build_body, load_body, save_body
    from runtime.experiment import load_experiment
    from runtime.mesh import Mesh, read_mesh

_HOMES = {
    "Mesh": "runtime.mesh",
    "ReducedBody": "runtime.body",
    "build_body": "runtime.body",
    "load_body": "runtime.body",
    "load_experiment": "runtime.experiment",
    "read_mesh": "runtime.mesh",
    "save_body": "runtime.body",
}

__all__ = [
    "Mesh",
    "ReducedBody",
    "SoftprintError",
    "build_body",
    "load_body",
    "load_experiment",
    "read_mesh",
    "save_body",
]


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module 'runtime' has no attribute {name!r}")
    return getattr(import_module(_HOMES[name]), name)
