"""The output of `softprint collider` for a mesh file, and the repaired surface as a file."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

import numpy as np

from softprint.runtime.arrays import Array, IntArray
from softprint.runtime.colliders.sampled.grid import GridCollider
from softprint.runtime.colliders.surface_mesh.examine import Examined, examine
from softprint.runtime.colliders.surface_mesh.mesh_collider import read_surface, surface_collider, unit_hint
from softprint.runtime.errors import SoftprintError
from softprint.runtime.inspect.summary import Summary
from softprint.runtime.io.files import atomic_path
from softprint.runtime.mesh.mesh import facet_vectors

_RESOLUTIONS = (8, 256)
# Points drawn on the file's surface, and how many grid cells deep they count as inside, as buried faces are.
_DRAWN, _INSIDE = 20_000, 3.0


def examined_surface(path: Path, scale: float, resolution: int) -> tuple[Summary, Examined]:
    """The defects, the repairs and the accuracy of the collider, with the repaired surface in the file's unit.

    scale: metres for each unit of the file. Raises SoftprintError if no collider can be made from it.
    """
    if not (np.isfinite(scale) and scale > 0):
        raise SoftprintError(f"--scale must be a positive number of metres, not {scale}")
    if not _RESOLUTIONS[0] <= resolution <= _RESOLUTIONS[1]:
        raise SoftprintError(
            f"--resolution must be from {_RESOLUTIONS[0]} to {_RESOLUTIONS[1]}, not {resolution}"
        )
    vertices, triangles = read_surface(path)
    examined = examine(vertices, triangles, str(path))
    started = time.perf_counter()
    collider = surface_collider(scale * examined.vertices, examined.triangles, resolution, path.stem)
    seconds = time.perf_counter() - started
    accuracy = collider.accuracy(np.random.default_rng(0))
    volume = float(np.linalg.det(scale * examined.vertices[examined.triangles]).sum() / 6)
    hint = unit_hint(2.0 * collider.size)
    done = {str(number): sentence for number, sentence in enumerate(examined.done, start=1)}
    as_collider: dict[str, Any] = {
        "as it is": f"refused: {examined.refusal}" if examined.refusal else "usable",
        "watertight": True,
        "triangles": len(examined.triangles),
        "middle": _middle(collider),
        "size": f"{collider.size:.4g} m, half of its largest extent{hint and '; '}{hint}",
        "volume": f"{volume:.4g} m^3",
        "grid cells": f"{resolution} of {collider.spacing:.3g} m along its longest side",
        "made in": f"{seconds:.1f} s",
        "error against the file": _against(collider, scale * vertices, triangles),
        "error at the surface": f"{accuracy['surface_rms']:.2g} m RMS, {accuracy['surface_max']:.2g} m at most",
        "error around it": f"{accuracy['band_rms']:.2g} m RMS, {accuracy['band_max']:.2g} m at most",
        "error of the slope": f"{accuracy['gradient_rms']:.2g} RMS at the surface",
    }
    sections = {
        "found, in the file's units": examined.found,
        "done": done or {"nothing": "was needed"},
        "as a collider": as_collider,
    }
    return Summary(path, "a triangle surface", sections), examined


def _against(collider: GridCollider, vertices: Array, triangles: IntArray) -> str:
    """How far the collider's surface is from that of the file, in metres: at points drawn by area."""
    rng, corners = np.random.default_rng(0), vertices[triangles]
    area = np.linalg.norm(facet_vectors(vertices, triangles), axis=1)
    drawn = corners[rng.choice(len(corners), size=_DRAWN, p=area / area.sum())]
    distance = collider.sdf(np.einsum("nc,ncd->nd", rng.dirichlet(np.ones(3), size=_DRAWN), drawn))
    inside = distance < -_INSIDE * collider.spacing
    if inside.all():
        return "the file's faces lie inside the collider"
    off = np.abs(distance[~inside])
    said = f"{np.sqrt(np.mean(off**2)):.2g} m RMS, {np.quantile(off, 0.95):.2g} m for 95 %, {off.max():.2g} m at most"
    return said + (
        f", without {inside.mean():.1%} of the file's area, which lies inside" if inside.any() else ""
    )


def _middle(collider: GridCollider) -> str:
    """Where the middle of the bounding box is."""
    middle = 0.5 * (collider.lower + collider.upper)
    said = "(" + ", ".join(f"{x:.4g}" for x in middle) + ") m"
    beside = float(np.linalg.norm(middle)) > collider.size
    return said + ("; the shape stands beside its origin: place it with `centre = true`" if beside else "")


def write_surface(path: Path, examined: Examined) -> None:
    """Write the repaired surface as binary STL, atomically."""
    import trimesh

    if path.suffix.lower() != ".stl":
        raise SoftprintError(f"{path}: the repaired surface is written as STL; call it {path.stem}.stl")
    mesh = trimesh.Trimesh(examined.vertices, examined.triangles, process=False)
    with atomic_path(path) as temporary:
        mesh.export(temporary, file_type="stl")
