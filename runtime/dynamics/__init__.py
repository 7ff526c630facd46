"""Reduced dynamics: backward Euler as minimisation over the handle rows, with learned corrections."""

from runtime.dynamics.drawn_beside import DrawnBeside
from runtime.dynamics.kinematic import KinematicHandle
from runtime.dynamics.newton import NewtonSettings, Status
from runtime.dynamics.placed import PlacedCollider
from runtime.dynamics.simulator import DynamicsSettings, Simulator
from runtime.dynamics.springs import HandleSpring
from runtime.dynamics.state import ContactForce, ReducedState, StepResult

__all__ = [
    "ContactForce",
    "DrawnBeside",
    "DynamicsSettings",
    "HandleSpring",
    "KinematicHandle",
    "NewtonSettings",
    "PlacedCollider",
    "ReducedState",
    "Simulator",
    "Status",
    "StepResult",
]
