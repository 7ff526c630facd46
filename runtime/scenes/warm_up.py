"""Compile all kernels of a simulation ahead of its first step.

Kernels are compiled at their first use (`runtime/compiled.py`), which takes most of a minute in all, and are then kept
on disk for every process to come. Here every kind of step is played once on bodies of a few cells, in 2D and 3D.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from itertools import product

import numpy as np
import trimesh

from softprint.runtime.body import assemble_body, frame_in_box, place_handles
from softprint.runtime.body.body import ReducedBody
from softprint.runtime.colliders import (
    Box,
    Collider,
    KeyframedPath,
    RigidPose,
    Sphere,
    mesh_collider,
    polygon_collider,
)
from softprint.runtime.contact import CoulombFriction, PenaltyContact
from softprint.runtime.dynamics import HandleSpring, KinematicHandle, PlacedCollider, Simulator
from softprint.runtime.elasticity import make_material
from softprint.runtime.learned.force.correction import ForceCorrection
from softprint.runtime.learned.force.model import ForceModel, ForceModelOptions
from softprint.runtime.mechanics.body_mechanics import BodyMechanics, compute_mechanics
from softprint.runtime.mesh import box_mesh
from softprint.runtime.rigid import free_collider

_SIZE = 0.1  # m, of the block
_STIFFNESS = 1e10  # N/m^4
_BAND = 5e-3  # m
_STEPS = 6  # the first ones have no active contact node of the step before to start from
DIMS = (2, 3)
# Bare, and with mechanics of one rotation and of several, with contact at nodes and on facets; smooth and rough;
# without and with a collider that moves freely.
_BODIES = ((1, False, 0), (1, False, 1), (1, True, 0), (2, True, 1))
_SCENES = tuple(product(_BODIES, (None, CoulombFriction(0.3)), (False, True)))


def n_scenes(dims: Sequence[int] = DIMS) -> int:
    """How many scenes `warm_up` plays."""
    return len(dims) * len(_SCENES)


def warm_up(dims: Sequence[int] = DIMS, progress: Callable[[int], None] = lambda n: None) -> None:
    """Compile the kernels of simulations of bodies in these dimensions, those that are not on disk yet. progress(1) is
    called after each of `n_scenes`."""
    for dim in dims:
        for simulator in _simulators(dim):
            state = simulator.settle().state
            for _ in range(_STEPS):
                state = simulator.step(state).state
            simulator.surface_positions(state)
            # One that pierces the body.
            inside = RigidPose(np.eye(dim), np.full(dim, 0.5 * _SIZE))
            simulator.step(state, {simulator.colliders[0].name: inside})
            progress(1)


def _simulators(dim: int) -> Iterator[Simulator]:
    """Of all scenes, with all kinds of colliders."""
    gravity = [0.0] * (dim - 1) + [-9.81]
    blocks = {frames: _block(dim, frames) for frames in (1, 2)}
    made = {frames: compute_mechanics(body, 60, True, gravity) for frames, body in blocks.items()}
    for (frames, with_mechanics, refinement), friction, free in _SCENES:
        body, law = blocks[frames], PenaltyContact(_STIFFNESS, refinement)
        mechanics = made[frames] if with_mechanics else None
        yield Simulator(
            body,
            _placed(body, mechanics, free, law),
            contact=law,
            mechanics=mechanics,
            friction=friction,
            gravity=gravity,
            springs=[HandleSpring(0, 10.0, KeyframedPath([0.0], [np.full(dim, 0.5 * _SIZE)]))],
            kinematic=[KinematicHandle("base")],
        )


def _block(dim: int, frames: int) -> ReducedBody:
    """Held below by a frame, and with a second one for more frames than one."""
    mesh = box_mesh([0.0] * dim, [_SIZE] * dim, [6] * dim)
    low, high = np.full(dim, -1.0), np.full(dim, 1.0)
    bottom, side, flank = high.copy(), low.copy(), high.copy()
    bottom[-1], side[-1], flank[0] = 0.2 * _SIZE, 0.5 * _SIZE, 0.2 * _SIZE
    regions = [frame_in_box(mesh, "base", [low, bottom])]
    if frames > 1:
        regions.append(frame_in_box(mesh, "side", [side, flank]))
    handles = place_handles(mesh, 4, regions)
    return assemble_body(mesh, handles, make_material("stable_neo_hookean", 2e4, 0.4), 1000.0, name="block")


def _placed(
    body: ReducedBody, mechanics: BodyMechanics | None, free: bool, law: PenaltyContact
) -> list[PlacedCollider]:
    """Shapes that touch the top of the block, the first of them led, and one that moves freely, 3 mm deep at first."""
    dim = body.dim
    placed = []
    for number, shape in enumerate(_shapes(dim)):
        above = np.full(dim, (0.3 + 0.2 * number) * _SIZE)
        above[-1] = 1.08 * _SIZE
        lower = above - 2e-3 * np.eye(dim)[-1]
        path = KeyframedPath([0.0, 0.05], [above, lower])
        correction = None if mechanics is None else _correction(body, shape, mechanics, law)
        placed.append(PlacedCollider(shape.name, shape, path, correction))
    if free:
        ball = Sphere(0.1 * _SIZE, dim, "free")
        pose = RigidPose(np.eye(dim), np.append(np.full(dim - 1, 0.75 * _SIZE), 1.07 * _SIZE))
        placed.append(PlacedCollider("free", ball, free=free_collider(ball, pose, density=1000.0)))
    return placed


def _shapes(dim: int) -> list[Collider]:
    """One of each kind of signed distance: a formula, a grid."""
    half = 0.1 * _SIZE
    if dim == 2:
        corners = half * np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
        return [Sphere(half, 2, "ball"), Box([half, half], name="box"), polygon_collider(corners)]
    solid = trimesh.creation.box(extents=[2.0 * half] * 3)
    return [
        Sphere(half, 3, "ball"),
        Box([half] * 3, name="box"),
        mesh_collider(solid.vertices, solid.faces, resolution=16),
    ]


def _correction(
    body: ReducedBody, shape: Collider, mechanics: BodyMechanics, law: PenaltyContact
) -> ForceCorrection:
    """Untrained."""
    options = ForceModelOptions((4,), "silu", 5e-4, _BAND, law.stiffness, refinement=law.refinement)
    return ForceCorrection("warm_up", ForceModel(options, body.dim, body.n_rows), body, shape, mechanics)
