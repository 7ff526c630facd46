"""glTF 2.0, as one file (.glb) or as JSON with its binary data beside it (.gltf and .bin).

    softprint      a node that turns z up to y up, as glTF has it (2D motions are y up already)
      body         a mesh at rest with one morph target a frame; an animation moves their weights from one to the next
      COLLIDER     a mesh with an animated translation and rotation, one node for each; lines in 2D

A player that blends linearly between two targets moves the surface on straight lines between the frames. Normals are
those of each frame, so that dents are shaded. Binary data goes to the disk frame by frame.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any, BinaryIO
from urllib.parse import quote

import numpy as np

from softprint.runtime.arrays import Array, IntArray
from softprint.runtime.colliders.pose import RigidPose
from softprint.runtime.convert.frames import Frame, SurfaceMotion, in_space, pose_in_space
from softprint.runtime.convert.gltf_document import Document
from softprint.runtime.drawing.colours import BODY, COLLIDER, error_colours, linear, rgb
from softprint.runtime.drawing.shading import Shading
from softprint.runtime.io.files import atomic_path

# Morph targets of one mesh: graphics cards keep each in a layer of a texture, and WebGL 2 promises 256 layers.
MOST_TARGETS = 250
# A displacement below this share of the body's size, a turn of a normal [rad] and a change of colour that nobody sees.
_STILL, _UNTURNED, _SAME_COLOUR = 1e-5, 2e-3, 2e-3
_Z_UP_TO_Y_UP = [-(0.5**0.5), 0.0, 0.0, 0.5**0.5]  # quaternion x, y, z, w
_LINES = 1  # primitive.mode


def write_gltf(out: Path, motion: SurfaceMotion, progress: Callable[[int], None]) -> list[Path]:
    """Write OUT.glb, or OUT.gltf and OUT.bin; returns their paths."""
    if out.suffix.lower() == ".glb":
        with atomic_path(out) as temporary, tempfile.TemporaryFile(dir=out.parent) as binary:
            _document(binary, motion, progress).write_glb(temporary, binary)
        return [out]
    data = out.with_suffix(".bin")
    with atomic_path(out) as temporary, atomic_path(data) as binary_path:
        with binary_path.open("wb") as file:
            document = _document(file, motion, progress)
        document.write_gltf(temporary, quote(data.name))
    return [out, data]


def _document(binary: BinaryIO, motion: SurfaceMotion, progress: Callable[[int], None]) -> Document:
    document = Document(binary)
    times = motion.times - motion.times[0]
    animation = _Animation(document, times)
    poses: dict[str, list[RigidPose]] = {name: [] for name in motion.solids}
    body = _body(document, motion, poses, progress)
    animation.add(body, "weights", np.eye(len(motion)).ravel())
    nodes = [body]
    solid_material = document.add("materials", _material("collider", COLLIDER, opacity=0.4))
    for name, (vertices, facets) in motion.solids.items():
        mesh = _solid_mesh(document, name, vertices, facets, solid_material)
        turns, places = _tracks(poses[name])
        node = document.add(
            "nodes",
            {"name": name, "mesh": mesh, "rotation": turns[0].tolist(), "translation": places[0].tolist()},
        )
        animation.add(node, "rotation", turns)
        animation.add(node, "translation", places)
        nodes.append(node)
    root: dict[str, Any] = {"name": "softprint", "children": nodes}
    if motion.dim == 3:
        root["rotation"] = _Z_UP_TO_Y_UP
    document.add("scenes", {"name": motion.source.label, "nodes": [document.add("nodes", root)]})
    document.json["scene"] = 0
    animation.finish()
    return document


class _Animation:
    """Channels over the same times; none for a single frame."""

    def __init__(self, document: Document, times: Array) -> None:
        self._document = document
        self._times = document.floats(times, bounds=True) if len(times) > 1 else None
        self._samplers: list[dict[str, Any]] = []
        self._channels: list[dict[str, Any]] = []

    def add(self, node: int, path: str, values: Array) -> None:
        if self._times is None:
            return
        output = self._document.floats(values)
        self._channels.append(
            {"sampler": len(self._samplers), "target": {"node": node, "path": path}},
        )
        self._samplers.append({"input": self._times, "output": output, "interpolation": "LINEAR"})

    def finish(self) -> None:
        if self._channels:
            self._document.add(
                "animations", {"name": "motion", "samplers": self._samplers, "channels": self._channels}
            )


def _body(
    document: Document,
    motion: SurfaceMotion,
    poses: dict[str, list[RigidPose]],
    progress: Callable[[int], None],
) -> int:
    """The node of the body with its morph targets; notes the poses of the colliders on the way."""
    rest = in_space(motion.rest)
    shading = Shading.of(rest, motion.triangles)
    normals, coloured = shading.normals(rest), motion.colouring is not None
    attributes = {
        "POSITION": document.floats(rest[shading.vertex], vertices=True, bounds=True),
        "NORMAL": document.floats(normals, vertices=True),
    }
    plain = _light(np.zeros(len(shading.vertex)), 1.0)
    if coloured:
        attributes["COLOR_0"] = document.floats(plain, vertices=True)
    still = _STILL * float(np.linalg.norm(np.ptp(rest, axis=0)))

    def target(frame: Frame) -> dict[str, int]:
        points = in_space(frame.points)
        moved = {"POSITION": document.deltas((points - rest)[shading.vertex], still, bounds=True)}
        if motion.dim == 3:
            moved["NORMAL"] = document.deltas(shading.normals(points) - normals, _UNTURNED)
        if frame.values is not None:
            colours = _light(frame.values[shading.vertex], motion.extent.top)
            moved["COLOR_0"] = document.deltas(colours - plain, _SAME_COLOUR)
        return moved

    targets = []
    for frame in motion.frames():
        targets.append(target(frame))
        for name, pose in frame.poses.items():
            poses[name].append(pose)
        progress(1)
    primitive = {
        "attributes": attributes,
        "indices": document.indices(shading.triangles),
        "material": document.add("materials", _material("body", "#ffffff" if coloured else BODY)),
        "targets": targets,
    }
    weights = [1.0] + [0.0] * (len(targets) - 1)
    names = {"targetNames": [f"{time:.4g} s" for time in motion.times]}
    mesh = document.add(
        "meshes", {"name": "body", "primitives": [primitive], "weights": weights, "extras": names}
    )
    return document.add("nodes", {"name": "body", "mesh": mesh})


def _light(values: Array, top: float) -> Array:
    return linear(error_colours(values, top))


def _solid_mesh(document: Document, name: str, vertices: Array, facets: IntArray, material: int) -> int:
    points = in_space(vertices)
    if facets.shape[1] == 2:
        primitive: dict[str, Any] = {
            "attributes": {"POSITION": document.floats(points, vertices=True, bounds=True)},
            "indices": document.indices(facets),
            "mode": _LINES,
        }
    else:
        shading = Shading.of(points, facets)
        primitive = {
            "attributes": {
                "POSITION": document.floats(points[shading.vertex], vertices=True, bounds=True),
                "NORMAL": document.floats(shading.normals(points), vertices=True),
            },
            "indices": document.indices(shading.triangles),
        }
    return document.add("meshes", {"name": name, "primitives": [{**primitive, "material": material}]})


def _tracks(poses: list[RigidPose]) -> tuple[Array, Array]:
    """Unit quaternions (n, 4) x, y, z, w, each on the side of the one before, and translations (n, 3) [m]."""
    from scipy.spatial.transform import Rotation

    placed = [pose_in_space(pose) for pose in poses]
    turns = Rotation.from_matrix(np.array([pose.rotation for pose in placed])).as_quat()
    against = (turns[1:] * turns[:-1]).sum(axis=1) < 0
    turns[1:][np.cumsum(against) % 2 == 1] *= -1
    return turns, np.array([pose.translation for pose in placed])


def _material(name: str, colour: str, opacity: float = 1.0) -> dict[str, Any]:
    surface = {
        "baseColorFactor": [*linear(rgb(colour)).tolist(), opacity],
        "metallicFactor": 0.0,
        "roughnessFactor": 0.55,
    }
    material = {"name": name, "pbrMetallicRoughness": surface, "doubleSided": True}
    return material if opacity == 1.0 else {**material, "alphaMode": "BLEND"}
