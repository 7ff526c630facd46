"""Contact and strain at places of a body's surface after a step, as the model computed them.

The forces are those on the colliders in this step, of every kind of contact: penalty at surface samples, nodes of a
condensed contact, and the friction of either. A force f_j (normal and friction, on the collider) acts on the part of
the surface nearest to its node, of area a_j at rest:

    t = -f_j / a_j        traction on the body [Pa], world frame, for each unit of rest area (first Piola-Kirchhoff)
    p = |f_j, normal| / a_j        contact pressure [Pa], likewise

so that the integral of t over the surface is the total force. Strain includes all corrections:

    E = (F^T F - I) / 2    Green strain [1], rest frame; |E| = sqrt(E : E)
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
import scipy.sparse as sp
from scipy.spatial import cKDTree

from softprint.runtime.arrays import Array, IntArray, scatter_sum
from softprint.runtime.body.body import ReducedBody
from softprint.runtime.contact.contact_force import SurfaceForces
from softprint.runtime.dynamics.state import StepResult
from softprint.runtime.touch.places import TouchPlaces


class Followed(Protocol):
    """A `Simulator`, or a `SceneModel` of any kind."""

    def follow(self, nodes: IntArray) -> Callable[[Any], Array]:
        """The positions of some nodes of the mesh, as a function of the state."""
        ...


@dataclass(frozen=True, eq=False)
class Touch:
    """Measurements at k places at one time [s]; definitions: see the module.

    position: (k, dim) [m], world frame; pressure: (k,) [Pa]; traction: (k, dim) [Pa] on the body, friction included;
    green_strain: (k, dim, dim) [1]; strain_norm: (k,) [1].
    """

    time: float
    position: Array
    pressure: Array
    traction: Array
    green_strain: Array
    strain_norm: Array


class SurfaceSpread:
    """The tractions at places of a body's surface that point forces on it amount to."""

    def __init__(self, body: ReducedBody, places: TouchPlaces) -> None:
        self.body, self.places = body, places
        self._spread: dict[int, tuple[IntArray, sp.csc_matrix]] = {}

    def pressure(self, parts: Iterable[SurfaceForces]) -> Array:
        """(k,) [Pa] of the normal forces among them."""
        pressure = np.zeros(len(self.places))
        for part in parts:
            if not part.tangential:
                pressure += self.to_places(part) @ np.linalg.norm(part.forces, axis=1)
        return pressure

    def to_places(self, part: SurfaceForces) -> sp.csc_matrix:
        """(k, m) [1/m^(dim-1)]: traction at the places for each unit of force."""
        key = id(part.nodes)
        if key not in self._spread:  # stored together with the nodes, so that their id stays unique
            self._spread[key] = part.nodes, self._spread_of(part.nodes)
        return self._spread[key][1][:, part.index]

    def _spread_of(self, nodes: IntArray) -> sp.csc_matrix:
        """(k, n): the matrix for forces at all of these nodes."""
        mesh = self.body.mesh
        in_contact_model = np.ones(len(mesh.surface_nodes), dtype=np.bool_)
        frames = self.body.handles.frame_nodes
        if not np.isin(nodes, frames).any():  # in this model there are no contact forces on rigid frames
            in_contact_model = ~np.isin(mesh.surface_nodes, frames)
        surface, areas = mesh.surface_nodes[in_contact_model], mesh.surface_areas[in_contact_model]
        owner = cKDTree(mesh.points[nodes]).query(mesh.points[surface])[1]
        own = scatter_sum(owner, areas, len(nodes))
        shape = mesh.n_nodes, len(nodes)
        return (self.places.spread @ sp.csr_matrix((1.0 / own[owner], (surface, owner)), shape)).tocsc()


class TouchSensor:
    """Measures contact and strain at `places` of a body that `source` simulates. The cost of `feel` grows with the
    number of places and of nodes in contact, not with the mesh."""

    def __init__(self, source: Followed, body: ReducedBody, places: TouchPlaces) -> None:
        self.body, self.places = body, places
        derivatives = [places.nodes @ derivative for derivative in body.mesh.nodal_gradient]
        used = [np.unique(matrix.indices) for matrix in (places.nodes, *derivatives)]
        watched = np.unique(np.concatenate(used))
        self._positions = source.follow(watched)
        self._mean = places.nodes[:, watched]
        self._derivatives = [derivative.tocsr()[:, watched] for derivative in derivatives]
        self._spread = SurfaceSpread(body, places)

    def feel(self, result: StepResult[Any]) -> Touch:
        """The measurements after a step, or at the start of a scene."""
        x = self._positions(result.state)
        F = np.stack([derivative @ x for derivative in self._derivatives], axis=-1)
        strain = 0.5 * (F.transpose(0, 2, 1) @ F - np.eye(x.shape[1]))
        pressure, traction = np.zeros(len(self.places)), np.zeros((len(self.places), x.shape[1]))
        for contact in result.contacts.values():
            for part in contact.parts:
                to_places = self._spread.to_places(part)
                traction -= to_places @ part.forces
                if not part.tangential:
                    pressure += to_places @ np.linalg.norm(part.forces, axis=1)
        norm = np.sqrt((strain * strain).sum(axis=(1, 2)))
        return Touch(result.state.time, self._mean @ x, pressure, traction, strain, norm)
