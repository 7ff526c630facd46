"""How a body looks in a picture: with its handles at rest, or deformed among its colliders."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Protocol

import numpy as np

from softprint.runtime.arrays import Array
from softprint.runtime.body.handles import Handles
from softprint.runtime.colliders.collider import Collider
from softprint.runtime.colliders.level_set import placed_surface
from softprint.runtime.colliders.pose import RigidPose
from softprint.runtime.drawing.colours import FRAMES, POINTS
from softprint.runtime.drawing.scene import Marks, Scene
from softprint.runtime.mesh import Mesh


class Shown(Protocol):
    """A collider under the name that its pose has, such as a `PlacedCollider`."""

    @property
    def name(self) -> str: ...
    @property
    def collider(self) -> Collider: ...


def handles_scene(name: str, mesh: Mesh, handles: Handles) -> Scene:
    """The mesh at rest with its point handles and the nodes of its frames."""
    frames = [
        Marks(f"frame {frame.name}", np.intersect1d(frame.nodes, mesh.surface_nodes), colour)
        for frame, colour in zip(handles.frames, FRAMES * len(handles.frames))
    ]
    points = [Marks("point handles", handles.points, POINTS)] if handles.n_points else []
    cells = mesh.cells if mesh.dim == 2 else None
    return Scene(name, mesh.points, mesh.facets, cells, marks=[*points, *frames], edges=True)


def deformed_scene(
    name: str, mesh: Mesh, positions: Array, colliders: Sequence[Shown], poses: Mapping[str, RigidPose]
) -> Scene:
    """The mesh at positions (n_nodes, dim), coloured by its displacement, and the colliders that have a pose."""
    placed = [placed_surface(shown.collider, poses[shown.name]) for shown in colliders if shown.name in poses]
    return Scene(
        name,
        positions,
        mesh.facets,
        mesh.cells if mesh.dim == 2 else None,
        values=1e3 * np.linalg.norm(positions - mesh.points, axis=1),
        label="displacement [mm]",
        solids=[surface for surface in placed if surface is not None],
    )
