"""Gymnasium environments of a tactile pad (gymnasium is an optional package: pip install 'softprint[gym]').

tactile_pad          the pad, its simulator and its camera, from plain arguments
tactile_environment  what the tasks have in common: actions, observations, how an episode ends
press_to_force       the task: press with a wanted force
find_edge            the task: bring the edge of a shape to the middle of the pad
scripted             policies that solve them, from observations alone
picture              what is rendered

Importing this package registers ``softprint/PressToForce-v0`` and ``softprint/FindEdge-v0``.
"""

from __future__ import annotations

from softprint.runtime.errors import SoftprintError

try:
    import gymnasium
except ImportError as error:
    raise SoftprintError("the environments need gymnasium: pip install 'softprint[gym]'") from error

from softprint.runtime.environments.find_edge import FindEdgeEnv
from softprint.runtime.environments.press_to_force import PressToForceEnv

__all__ = ["FindEdgeEnv", "PressToForceEnv", "register_environments"]

_TASKS = {"softprint/PressToForce-v0": PressToForceEnv, "softprint/FindEdge-v0": FindEdgeEnv}


def register_environments() -> None:
    """Register the environments with gymnasium; once, however often it is called."""
    for name, environment in _TASKS.items():
        if name not in gymnasium.registry:
            gymnasium.register(name, entry_point=f"{environment.__module__}:{environment.__name__}")


register_environments()
