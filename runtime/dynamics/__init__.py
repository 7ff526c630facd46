"""Reduced dynamics: backward Euler as minimisation over the handle rows, with learned corrections."""

from runtime.contact.contact_force import ContactForce
from runtime.dynamics.kinematic import KinematicHandle
from runtime.dynamics.newton import NewtonSettings, Status
from runtime.dynamics.placed_collider import PlacedCollider
from runtime.dynamics.simulator import DynamicsSettings, Simulator
from runtime.dynamics.state import ReducedState, StepResult
from runtime.dynamics.terms.springs import HandleSpring

__all__ = [
    "ContactForce",
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
