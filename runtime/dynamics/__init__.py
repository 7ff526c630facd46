"""Reduced dynamics: backward Euler as minimisation over the handle rows, with learned corrections."""

from softprint.runtime.contact.contact_force import ContactForce
from softprint.runtime.dynamics.kinematic import KinematicHandle
from softprint.runtime.dynamics.placed_collider import PlacedCollider
from softprint.runtime.dynamics.settings import DynamicsSettings
from softprint.runtime.dynamics.simulator import Simulator
from softprint.runtime.dynamics.state import ReducedState, StepResult
from softprint.runtime.dynamics.terms.springs import HandleSpring
from softprint.runtime.optimise import NewtonSettings, Status

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
