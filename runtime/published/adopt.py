"""Convert a published data set to a body, a truth file and an experiment for `softprint train`.

Values that a published file does not contain, and their replacements:

* material and density: the user gives them;
* the internal displacement of a state: 0. So the contact displacement is x - U q, as in the papers for the jelly, and
contains everything that the full space adds to the subspace;
* which samples belong to one contact: consecutive samples with the same handles and the same rotation;
* the accuracy of a sample: its status is "converged", and residual, decrement, energy and iterations are NaN or 0.
Smallest det F, depth and penetration are computed here;
* contact stiffness, gravity, scenes: the experiment has defaults, no gravity and no scenes, so corrections can be
trained, but not simulated until these are filled in.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from softprint.runtime.arrays import Array, BoolArray, IntArray
from softprint.runtime.body.body import ReducedBody
from softprint.runtime.body.build import assemble_body
from softprint.runtime.body.handles import FrameHandle, Handles
from softprint.runtime.colliders.collider import Collider
from softprint.runtime.colliders.surface_points import surface_points
from softprint.runtime.contact.intrusion import intrusion
from softprint.runtime.elasticity.invariants import determinant
from softprint.runtime.elasticity.materials import Material
from softprint.runtime.errors import SoftprintError
from softprint.runtime.mesh.check import oriented_mesh
from softprint.runtime.published.handles import FoundHandles, find_handles
from softprint.runtime.published.layout import PublishedData, PublishedObject
from softprint.runtime.truth.truth_file import TruthHeader, create_truth
from softprint.runtime.truth.truth_schema import CONVERGED, TABLES

SAME = 1e-5  # handles and rotations that differ by less are the same: the files are float32
_RIGID = 1e-3  # a collider whose points deviate more from a rigid motion is not rigid
_BATCH = 64  # samples in memory at once


@dataclass(frozen=True, eq=False)
class AdoptedBody:
    """The body, its handles as found in the basis, and the published node of each of its nodes."""

    body: ReducedBody
    handles: FoundHandles
    nodes: IntArray


def adopt_body(
    published: PublishedObject, material: Material, density: float, scale: float, source: str
) -> AdoptedBody:
    """A body from W, q_ref and the simplices; scale: metres for each unit of the file.

    Rest positions are rounded to float32, as in the mesh file that is written with it. Raises SoftprintError if the
    arrays do not form a body.
    """
    dim = published.dim
    cells = published.simplices_of(dim + 1)
    if cells is None:
        raise SoftprintError(
            f"{source}: {published.name} has no simplices of {dim + 1} nodes: nothing fills the body"
        )
    found = find_handles(published, source)
    rest = (scale * published.rest).astype(np.float32).astype(np.float64)
    mesh = oriented_mesh(rest, cells, f"{source}: {published.name}")
    nodes = np.unique(cells)  # in the order of oriented_mesh
    place = np.full(len(rest), -1)
    place[nodes] = np.arange(len(nodes))
    frames = []
    for number, region in enumerate(found.frames):
        own = place[region][place[region] >= 0]
        frames.append(FrameHandle(f"frame{number}", own, mesh.points[own].mean(axis=0)))
    handles = Handles(dim, place[found.points], tuple(frames))
    if (handles.points < 0).any():
        raise SoftprintError(f"{source}: a point handle of {published.name} is a node of no cell")
    # W M = [X 1] in a frame has X in the file's unit; our rows of frames act on metres.
    in_metres = np.where(handles.affine_part > 0, 1.0, scale)
    basis = (published.basis @ found.to_published)[nodes] * in_metres
    off = float(np.abs(basis @ handles.rest_rows(mesh.points) - mesh.points).max())
    if off > SAME * mesh.size:
        raise SoftprintError(
            f"{source}: W does not reproduce the rest shape of {published.name} from its handles (off by {off:.1e} m)"
        )
    # The thesis's states are projections onto U (5.3.3), and the data say nothing of masses.
    body = assemble_body(
        mesh, handles, material, density, name=published.name, basis=basis, hold="projection"
    )
    return AdoptedBody(body, found, nodes)


def adopted_rows(adopted: AdoptedBody, q: Array, scale: float) -> Array:
    """Our handle rows (n, n_rows, dim) of published ones (n, n_rows, dim); rotations of frames are made exact."""
    handles = adopted.body.handles
    metres = np.where(handles.affine_part > 0, scale, 1.0)[:, None]
    return np.stack([handles.rigid(rows) for rows in adopted.handles.rows(q) * metres])


def adopted_poses(collider: PublishedObject, z: Array, scale: float, source: str) -> tuple[Array, Array]:
    """Rotations (n, dim, dim) and translations (n, dim) [m]: the rigid motions that take the collider's points from
    rest, W z_ref, to W z. Raises SoftprintError if they do not move rigidly."""
    rest = collider.rest
    centre = rest.mean(axis=0)
    # W z is linear in z, so its fit to a motion needs the moments of W alone: x = X R^T + t.
    moment = (rest - centre).T @ (collider.basis - collider.basis.mean(axis=0)) @ z  # (n, dim, dim)
    u, _, vt = np.linalg.svd(moment)
    flip = np.ones((len(z), collider.dim))
    flip[:, -1] = np.sign(np.linalg.det(u @ vt))
    rotation = (u * flip[:, None] @ vt).transpose(0, 2, 1)
    now = collider.basis.mean(axis=0) @ z
    translation = now - np.einsum("nij,j->ni", rotation, centre)
    size = float(np.ptp(rest, axis=0).max())
    for sample in np.unique(np.linspace(0, len(z) - 1, 50).astype(int)):
        off = np.abs(collider.basis @ z[sample] - rest @ rotation[sample].T - translation[sample]).max()
        if off > _RIGID * size:
            raise SoftprintError(
                f"{source}: the collider does not move rigidly in sample {sample} (off by {off:.1e})"
            )
    return rotation, scale * translation


@dataclass(frozen=True, eq=False)
class Grouping:
    """state (n,), contact (n,) and depth_index (n,) of every sample; first_of_state, first_of_contact: samples."""

    state: IntArray
    contact: IntArray
    depth_index: IntArray
    first_of_state: IntArray
    first_of_contact: IntArray


def group_samples(q: Array, rotation: Array) -> Grouping:
    """States are distinct handle rows, numbered in order of appearance; a contact is a run of samples of one state and
    rotation."""
    n = len(q)
    rounded = np.round(q.reshape(n, -1) / SAME).astype(np.int64)
    same_as_before = np.abs(np.diff(q.reshape(n, -1), axis=0)).max(axis=1, initial=0.0) < SAME
    # Equality with the previous sample takes precedence over rounding, which may go either way.
    leader = np.maximum.accumulate(np.where(np.r_[False, same_as_before], 0, np.arange(n)))
    _, first, inverse = np.unique(rounded[leader], axis=0, return_index=True, return_inverse=True)
    order = np.argsort(first)
    state = np.argsort(order)[inverse.reshape(-1)]
    changed = np.abs(np.diff(rotation.reshape(n, -1), axis=0)).max(axis=1, initial=0.0) >= SAME
    starts: BoolArray = np.r_[True, changed | (np.diff(state) != 0)]
    contact = np.cumsum(starts) - 1
    first_of_contact = np.flatnonzero(starts)
    return Grouping(state, contact, np.arange(n) - first_of_contact[contact], first[order], first_of_contact)


def write_adopted_truth(
    path: Path,
    adopted: AdoptedBody,
    collider: Collider,
    data: PublishedData,
    poses: tuple[Array, Array],
    scale: float,
    experiment: str,
    made_from: dict[str, str],
    progress: Callable[[int], None] = lambda n: None,
) -> Grouping:
    """Write truth.h5; poses: of every sample, as :func:`adopted_poses` gives them."""
    rows = adopted_rows(adopted, data.q, scale)
    groups = group_samples(rows, poses[0])
    body = adopted.body
    header = TruthHeader(
        body.content_hash, experiment, 0, (collider.name,), len(groups.first_of_contact), made_from
    )
    with create_truth(path, header, body) as truth:
        for first in groups.first_of_state:
            truth.append("states", _state(body, rows[first]))
        truth.append("refused", _nothing(body, "refused"))
        truth.append("contacts", _contacts(groups, poses[0]))
        reduced = [body.reduced_positions(rows[first]) for first in groups.first_of_state]
        for start in range(0, len(data), _BATCH):
            some = slice(start, min(start + _BATCH, len(data)))
            x = scale * data.positions(some)[:, adopted.nodes]
            truth.append("samples", _samples(body, collider, groups, some, poses, x, reduced))
            progress(len(x))
        truth.append("repeat", _nothing(body, "repeat"))
    return groups


def _state(body: ReducedBody, rows: Array) -> dict[str, Any]:
    unknown = [np.nan]
    return {
        "rows": rows[None],
        "internal": np.zeros((1, body.n_nodes, body.dim)),
        **dict.fromkeys(("residual", "decrement", "min_eigenvalue", "energy", "time", "seconds"), unknown),
        "handle_force": np.full((1, *rows.shape), np.nan),
        "min_det_F": [_min_det_F(body, body.reduced_positions(rows))],
        "stable": [False],
        "scene": ["published"],
        "frame": [-1],
    }


def _nothing(body: ReducedBody, table: str) -> dict[str, Any]:
    sizes = {"nodes": body.n_nodes, "rows": body.n_rows, "dim": body.dim}
    return {
        key: np.empty((0, *column.row_shape(sizes)), dtype=object if column.dtype == "str" else column.dtype)
        for key, column in TABLES[table].items()
    }


def _contacts(groups: Grouping, rotation: Array) -> dict[str, Any]:
    first = groups.first_of_contact
    n, dim = len(first), rotation.shape[1]
    return {
        "unit": np.arange(n),
        "state": groups.state[first],
        "collider": np.zeros(n, dtype=int),
        "place": np.full(n, -1),
        "rotation_index": np.full(n, -1),
        "rotation": rotation[first],
        "direction": np.full((n, dim), np.nan),
        "thickness": np.full(n, np.nan),
        "seconds": np.full(n, np.nan),
    }


def _samples(
    body: ReducedBody,
    collider: Collider,
    groups: Grouping,
    some: slice,
    poses: tuple[Array, Array],
    x: Array,
    reduced: list[Array],
) -> dict[str, Any]:
    state, (rotation, translation) = groups.state[some], (poses[0][some], poses[1][some])
    before = np.stack([reduced[k] for k in state])
    n, nodes, surface = len(x), body.mesh.surface_nodes, surface_points(collider)

    def deepest(points: Array) -> Array:
        local = (points[:, nodes] - translation[:, None]) @ rotation  # z = R^T (x - t)
        distance = collider.sdf(local.reshape(-1, body.dim)).reshape(n, -1)
        return np.maximum(0.0, -distance.min(axis=1))

    depth = deepest(before)
    return {
        "contact": groups.contact[some],
        "depth_index": groups.depth_index[some],
        "depth": depth,
        "pose_rotation": rotation,
        "pose_translation": translation,
        "displacement": x - before,
        "status": np.full(n, CONVERGED),
        "reason": ["Published without its accuracy."] * n,
        "branch_flag": np.zeros(n, dtype=bool),
        **dict.fromkeys(("node_speed", "residual", "decrement", "energy", "seconds"), np.full(n, np.nan)),
        **dict.fromkeys(("newton_iterations", "cg_iterations"), np.zeros(n, dtype=int)),
        "handle_force": np.full((n, *body.rest_rows.shape), np.nan),
        "min_det_F": [_min_det_F(body, positions) for positions in x],
        "max_depth": deepest(x),
        "intrusion": [
            intrusion(surface @ R.T + t, body.mesh, positions).depth
            for R, t, positions in zip(rotation, translation, x, strict=True)
        ],
    }


def _min_det_F(body: ReducedBody, positions: Array) -> float:
    return float(determinant(body.mesh.deformation_gradients(positions)).min())
