"""Softprint: soft bodies that show, in real time, every dent that an object leaves in them.

    import softprint

    body = softprint.load_body("runs/jelly3d_small/body.h5")

Names are imported from their modules on first use, so `import softprint` is quick.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from softprint.runtime.errors import SoftprintError

if TYPE_CHECKING:
    from softprint.runtime import colliders
    from softprint.runtime.body import (
        ReducedBody,
        assemble_body,
        build_body,
        frame_in_box,
        load_body,
        place_handles,
        save_body,
    )
    from softprint.runtime.colliders import KeyframedPath, RigidPose
    from softprint.runtime.colliders.build import build_collider
    from softprint.runtime.contact import CoulombFriction, PenaltyContact
    from softprint.runtime.convert.film import FilmLook
    from softprint.runtime.convert.formats import convert_motion
    from softprint.runtime.convert.sampling import Sampling
    from softprint.runtime.dynamics import (
        DynamicsSettings,
        HandleSpring,
        KinematicHandle,
        NewtonSettings,
        PlacedCollider,
        Simulator,
    )
    from softprint.runtime.dynamics.state_file import load_state, save_state
    from softprint.runtime.elasticity import make_material
    from softprint.runtime.environments import register_environments
    from softprint.runtime.experiment import load_experiment
    from softprint.runtime.learned.correction_file import load_correction
    from softprint.runtime.linalg.one_thread import one_thread
    from softprint.runtime.mechanics.body_mechanics import compute_mechanics
    from softprint.runtime.mechanics.mechanics_file import load_mechanics, save_mechanics
    from softprint.runtime.mesh import Mesh, box_mesh, read_mesh
    from softprint.runtime.rigid import free_collider
    from softprint.runtime.scenes.background_drawing import BackgroundDrawing
    from softprint.runtime.scenes.motion_file import Motion, load_motion
    from softprint.runtime.scenes.playing import simulate
    from softprint.runtime.scenes.recording import Recording
    from softprint.runtime.scenes.warm_up import warm_up
    from softprint.runtime.touch import TactileCamera, TouchSensor, point_places

_MODULES = {
    "BackgroundDrawing": "scenes.background_drawing",
    "CoulombFriction": "contact",
    "DynamicsSettings": "dynamics",
    "FilmLook": "convert.film",
    "HandleSpring": "dynamics",
    "KeyframedPath": "colliders",
    "KinematicHandle": "dynamics",
    "Mesh": "mesh",
    "Motion": "scenes.motion_file",
    "NewtonSettings": "dynamics",
    "PenaltyContact": "contact",
    "PlacedCollider": "dynamics",
    "Recording": "scenes.recording",
    "ReducedBody": "body",
    "RigidPose": "colliders",
    "Sampling": "convert.sampling",
    "Simulator": "dynamics",
    "TactileCamera": "touch",
    "TouchSensor": "touch",
    "assemble_body": "body",
    "box_mesh": "mesh",
    "build_body": "body",
    "build_collider": "colliders.build",
    "compute_mechanics": "mechanics.body_mechanics",
    "convert_motion": "convert.formats",
    "frame_in_box": "body",
    "free_collider": "rigid",
    "load_body": "body",
    "load_correction": "learned.correction_file",
    "load_experiment": "experiment",
    "load_mechanics": "mechanics.mechanics_file",
    "load_motion": "scenes.motion_file",
    "load_state": "dynamics.state_file",
    "make_material": "elasticity",
    "one_thread": "linalg.one_thread",
    "place_handles": "body",
    "point_places": "touch",
    "read_mesh": "mesh",
    "register_environments": "environments",
    "save_body": "body",
    "save_mechanics": "mechanics.mechanics_file",
    "save_state": "dynamics.state_file",
    "simulate": "scenes.playing",
    "warm_up": "scenes.warm_up",
}

__all__ = [
    "BackgroundDrawing",
    "CoulombFriction",
    "DynamicsSettings",
    "FilmLook",
    "HandleSpring",
    "KeyframedPath",
    "KinematicHandle",
    "Mesh",
    "Motion",
    "NewtonSettings",
    "PenaltyContact",
    "PlacedCollider",
    "Recording",
    "ReducedBody",
    "RigidPose",
    "Sampling",
    "Simulator",
    "SoftprintError",
    "TactileCamera",
    "TouchSensor",
    "assemble_body",
    "box_mesh",
    "build_body",
    "build_collider",
    "colliders",
    "compute_mechanics",
    "convert_motion",
    "frame_in_box",
    "free_collider",
    "load_body",
    "load_correction",
    "load_experiment",
    "load_mechanics",
    "load_motion",
    "load_state",
    "make_material",
    "one_thread",
    "place_handles",
    "point_places",
    "read_mesh",
    "register_environments",
    "save_body",
    "save_mechanics",
    "save_state",
    "simulate",
    "warm_up",
]


def __getattr__(name: str) -> Any:
    if name == "colliders":
        return import_module("softprint.runtime.colliders")
    if name not in _MODULES:
        raise AttributeError(f"module 'softprint' has no attribute {name!r}")
    return getattr(import_module(f"softprint.runtime.{_MODULES[name]}"), name)
