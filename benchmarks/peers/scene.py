"""The scene: one body, a ball that is led, and the frames at which all engines are compared."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from softprint.runtime.arrays import Array, IntArray
from softprint.runtime.body import ReducedBody
from softprint.runtime.colliders import KeyframedPath, RigidPose, Sphere
from softprint.runtime.contact.surface_quadrature import FacetPoints, SurfaceQuadrature
from softprint.runtime.elasticity.materials import make_material
from softprint.runtime.experiment import Experiment

FRAME = 1.0 / 60.0  # s, between two frames
RADIUS = 0.018  # m, of the ball
CLEAR, DEPTH, DRAG = 0.001, 0.007, 0.02  # m: above the undeformed top at first; below it; sideways
# s: begins, is down, is dragged, has been, is up.
TIMES = (0.0, 0.4, 0.45, 1.0, 1.05, 1.35)
# Points of a facet, along an edge, at which the depth of the collider is measured.
_MEASURED = 4


@dataclass(frozen=True, eq=False)
class Scene:
    """experiment: has material, contact and tolerances; path: of the collider; gravity: [m/s^2]; duration: [s]."""

    name: str
    experiment: Experiment
    body: ReducedBody
    collider: Sphere
    path: KeyframedPath
    gravity: Array
    duration: float

    @property
    def held(self) -> IntArray:
        """Nodes that do not move: the frames of the body."""
        return np.unique(np.concatenate([frame.nodes for frame in self.body.handles.frames]))

    @property
    def free(self) -> IntArray:
        """The other nodes."""
        return np.setdiff1d(np.arange(self.body.n_nodes), self.held)

    @property
    def density(self) -> float:
        """[kg/m^3]."""
        return float(self.experiment.body.material.density)

    @property
    def elastic(self) -> tuple[float, float]:
        """Young's modulus [Pa] and Poisson's ratio."""
        material = self.experiment.body.material
        return float(material.young), float(material.poisson)

    @property
    def lame(self) -> tuple[float, float]:
        """mu and lambda [Pa]: of every law, at small strain."""
        law = make_material("stable_neo_hookean", *self.elastic)
        return float(law.lame_mu), float(law.lame_lambda)

    @property
    def n_frames(self) -> int:
        """Frames after the first."""
        return round(self.duration / FRAME)

    def pose(self, time: float) -> RigidPose:
        """Of the collider."""
        return self.path.pose(time)

    def depth(self, x: Array, time: float) -> float:
        """How deep the body's surface is in the collider [m], with the nodes at x: at its points, without any law."""
        points = self._points.positions(x)
        return max(0.0, -float(self.collider.sdf(self.pose(time).apply_inverse(points)).min()))

    def pulled(self, gravity: Array) -> Scene:
        """With another gravity, and the collider out of reach."""
        away = KeyframedPath.constant(RigidPose(np.eye(3), np.array([0.0, 0.0, 100.0 * self.body.mesh.size])))
        return replace(self, gravity=gravity, path=away)

    @cached_property
    def _points(self) -> FacetPoints:
        quadrature = SurfaceQuadrature.of(self.body.mesh, _MEASURED)
        return quadrature.points(np.arange(len(quadrature.facets) * len(quadrature.shares)))


def ball(experiment: Experiment, body: ReducedBody) -> Scene:
    """A ball is pressed into the top, dragged sideways and lifted."""
    high = float(body.mesh.points[:, 2].max()) + RADIUS
    heights = [high + CLEAR, high - DEPTH, high - DEPTH, high - DEPTH, high - DEPTH, high + 3.0 * CLEAR]
    along = np.array([-0.5, -0.5, -0.5, 0.5, 0.5, 0.5]) * DRAG
    path = KeyframedPath(TIMES, [[x, 0.003, z] for x, z in zip(along, heights, strict=True)])
    gravity = np.asarray(experiment.dynamics.gravity, dtype=float)
    return Scene("ball", experiment, body, Sphere(RADIUS, 3, "ball"), path, gravity, TIMES[-1])
