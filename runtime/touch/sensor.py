"""What is felt at places of a body's surface after a step: the model's own contact, and strain.

The forces are those that pushed the colliders in this step, whatever bears them in the model: penalty at surface
samples, loads of a condensed contact, friction of either. A load f_j (normal and friction, on the collider) acts on the
part of the surface that is nearer to its node than to those of the others, of area a_j at rest:

    t = -f_j / a_j        traction on the body [Pa], world frame, for each unit of rest area (first Piola-Kirchhoff)
    p = |f_j, normal| / a_j        contact pressure [Pa], likewise

so that the sum of t over the surface is the whole force. Strain is that of the drawn detail, corrections included:

    E = (F^T F - I) / 2    Green strain [1], rest frame; |E| = sqrt(E : E)
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
import scipy.sparse as sp
from scipy.spatial import cKDTree

from runtime.arrays import Array, IntArray, scatter_sum
from runtime.body.body import ReducedBody
from runtime.contact.contact_force import SurfaceForces
from runtime.dynamics.state import StepResult
from runtime.touch.places import TouchPlaces


class Followed(Protocol):
    """A `Simulator`, or a `SceneModel` of any kind."""

    def follow(self, nodes: IntArray) -> Callable[[Any], Array]:
        """Where some nodes of the mesh are, as a function of the state."""
        ...


@dataclass(frozen=True, eq=False)
class Touch:
    """What is felt at k places at one time [s]; see the module for what each is.

    position: (k, dim) [m], world frame; pressure: (k,) [Pa]; traction: (k, dim) [Pa] on the body, friction included;
    green_strain: (k, dim, dim) [1]; strain_norm: (k,) [1].
    """

    time: float
    position: Array
    pressure: Array
    traction: Array
    green_strain: Array
    strain_norm: Array


class TouchSensor:
    """Feels at `places` of a body what `source` makes of it; the cost of `feel` grows with the places and the loads in
    contact, not with the mesh."""

    def __init__(self, source: Followed, body: ReducedBody, places: TouchPlaces) -> None:
        self.body, self.places = body, places
        derivatives = [places.nodes @ derivative for derivative in body.mesh.nodal_gradient]
        used = [np.unique(matrix.indices) for matrix in (places.nodes, *derivatives)]
        watched = np.unique(np.concatenate(used))
        self._positions = source.follow(watched)
        self._mean = places.nodes[:, watched]
        self._derivatives = [derivative.tocsr()[:, watched] for derivative in derivatives]
        self._spread: dict[int, tuple[IntArray, sp.csc_matrix]] = {}

    def feel(self, result: StepResult[Any]) -> Touch:
        """After a step, or at the start of a scene."""
        x = self._positions(result.state)
        F = np.stack([derivative @ x for derivative in self._derivatives], axis=-1)
        strain = 0.5 * (F.transpose(0, 2, 1) @ F - np.eye(x.shape[1]))
        pressure, traction = np.zeros(len(self.places)), np.zeros((len(self.places), x.shape[1]))
        for contact in result.contacts.values():
            for load in contact.loads:
                to_places = self._to_places(load)
                traction -= to_places @ load.forces
                if not load.tangential:
                    pressure += to_places @ np.linalg.norm(load.forces, axis=1)
        norm = np.sqrt((strain * strain).sum(axis=(1, 2)))
        return Touch(result.state.time, self._mean @ x, pressure, traction, strain, norm)

    def _to_places(self, load: SurfaceForces) -> sp.csc_matrix:
        """(k, m) [1/m^(dim-1)]: traction at the places for each unit of force."""
        key = id(load.nodes)
        if key not in self._spread:  # kept with the nodes it is of, whose id is then theirs alone
            self._spread[key] = load.nodes, self._spread_of(load.nodes)
        return self._spread[key][1][:, load.index]

    def _spread_of(self, nodes: IntArray) -> sp.csc_matrix:
        """(k, n): of all the loads that there could be at these nodes."""
        mesh = self.body.mesh
        bears = np.ones(len(mesh.surface_nodes), dtype=np.bool_)
        frames = self.body.handles.frame_nodes
        if not np.isin(nodes, frames).any():  # rigid parts bear nothing in this model
            bears = ~np.isin(mesh.surface_nodes, frames)
        surface, areas = mesh.surface_nodes[bears], mesh.surface_areas[bears]
        owner = cKDTree(mesh.points[nodes]).query(mesh.points[surface])[1]
        own = scatter_sum(owner, areas, len(nodes))
        shape = mesh.n_nodes, len(nodes)
        return (self.places.spread @ sp.csr_matrix((1.0 / own[owner], (surface, owner)), shape)).tocsc()
