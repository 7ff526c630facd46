"""Export our body and truth in the published layout: float32, frames before points, poses as [R^T; t]."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
from scipy.spatial import Delaunay

from softprint.runtime.arrays import Array, IntArray
from softprint.runtime.body.body import ReducedBody
from softprint.runtime.colliders.collider import Collider
from softprint.runtime.colliders.level_set import collider_surface
from softprint.runtime.errors import SoftprintError
from softprint.runtime.io.files import provenance
from softprint.runtime.published.layout import PublishedMeshes, PublishedObject, write_dataset, write_meshes
from softprint.runtime.truth.truth_file import TruthData

# Grid cells along a collider for the extraction of its surface: gives some thousand triangles, as published colliders
# have.
CELLS = {2: 160, 3: 40}


def frames_first(body: ReducedBody) -> IntArray:
    """(n_rows,) the index of our row for each published row."""
    n_points = body.handles.n_points
    return np.r_[n_points : body.n_rows, 0:n_points].astype(np.int64)


def published_meshes(body: ReducedBody, collider: Collider) -> PublishedMeshes:
    """Body and collider in the layout of `meshes.h5`.

    In 3D `tets` are the cells and `tris` the surface; in 2D both are the triangles, as in the tables of 2021 (`tris`)
    and 2022 (`tets`). The collider is the zero level of its signed distance.
    """
    order, mesh = frames_first(body), body.mesh
    surface = mesh.facets if body.dim == 3 else mesh.cells
    return PublishedMeshes(
        PublishedObject(
            body.name, body.basis[:, order], body.rest_rows[order], {"tris": surface, "tets": mesh.cells}
        ),
        published_collider(collider),
    )


def published_collider(collider: Collider) -> PublishedObject:
    """The collider as a group of `meshes.h5`: W = [X 1], so that z is [R^T; t]."""
    vertices, facets = collider_surface(collider, CELLS[collider.dim])
    rest = np.vstack([np.eye(collider.dim), np.zeros(collider.dim)])
    basis = np.column_stack([vertices, np.ones(len(vertices))])
    if collider.dim == 2:
        facets = Delaunay(vertices).simplices.astype(np.int64)
        facets = facets[collider.sdf(vertices[facets].mean(axis=1)) < 0]
    return PublishedObject(collider.name, basis, rest, {"tris": facets})


def export_published(
    folder: Path,
    truth: TruthData,
    body: ReducedBody,
    collider: Collider,
    progress: Callable[[int], None] = lambda n: None,
) -> tuple[Path, Path, int]:
    """Write `meshes.h5` and `dataset.h5`; returns their paths and the number of samples.

    Only samples usable for training are written, because the layout has no status. x is U q plus the internal and the
    contact displacement.
    """
    samples = published_samples(truth, collider)
    if body.name == collider.name:
        raise SoftprintError(
            f"body and collider are both called {body.name!r}, and the layout has one group for each"
        )
    notes = {
        "unit": "m",
        "body_hash": body.content_hash,
        "truth_hash": truth.content_hash,
        "experiment": truth.header.experiment,
        "provenance": json.dumps(provenance(), sort_keys=True),
    }
    meshes, dataset = folder / "meshes.h5", folder / "dataset.h5"
    order, sizes = frames_first(body), (body.n_nodes, body.n_rows, body.dim)
    with write_dataset(dataset, len(samples), sizes, notes) as writer:
        states, known = truth.sample_state, -1
        for sample in samples:
            if states[sample] != known:
                known = int(states[sample])
                rows = truth.states["rows"][known]
                equilibrium = body.reduced_positions(rows) + truth.internal(known)
            pose = truth.pose(sample)
            x = equilibrium + truth.displacement(sample)
            writer.append(rows[order], pose_rows(pose.rotation, pose.translation), x)
            progress(1)
    write_meshes(meshes, published_meshes(body, collider), notes)
    return meshes, dataset, len(samples)


def published_samples(truth: TruthData, collider: Collider) -> list[int]:
    """The exported samples: usable, and of this collider."""
    if collider.name not in truth.header.colliders:
        known = ", ".join(truth.header.colliders)
        raise SoftprintError(
            f"{truth.path}: has no samples of a collider {collider.name!r}; it has those of: {known}"
        )
    number = truth.header.colliders.index(collider.name)
    of_collider = truth.contacts["collider"][truth.samples["contact"]] == number
    samples = np.flatnonzero(truth.usable & of_collider)
    if not len(samples):
        raise SoftprintError(f"{truth.path}: no sample of {collider.name!r} is usable for training")
    return [int(sample) for sample in samples]


def pose_rows(rotation: Array, translation: Array) -> Array:
    """(dim+1, dim): R^T above t."""
    return np.vstack([rotation.T, translation])
