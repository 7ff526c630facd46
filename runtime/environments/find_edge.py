"""The task to find an edge by touch: a block with rounded edges is held above the pad, and one of its edges is to be
brought over the middle of the pad, while it touches.

How the block is held is not observed: it is turned about the vertical by any angle, and shifted; ``indenter`` is the
pose of what holds it. The goal is met where the middle of the pad is within 0.5 mm of the outline of the block and the
force is between 0.05 and 3 N, for ten actions in a row.

Reward of an action: -min(1, distance to the outline / 5 mm), less 0.5 without contact or with more force, and 10 for
success.
"""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np
from gymnasium import spaces

from softprint.runtime.arrays import Array
from softprint.runtime.colliders import Box, Collider, RigidPose
from softprint.runtime.environments.tactile_environment import MILLIMETRES, Observation, TactileEnv
from softprint.runtime.touch.tactile_camera import TactileImage


class FindEdgeEnv(TactileEnv):
    """See the module. Observes depth and force by default."""

    senses = ("depth", "force")
    half_extents: ClassVar[tuple[float, float, float]] = (0.003, 0.0045, 0.003)  # m
    rounding: ClassVar[float] = 3e-4  # m
    tolerance: ClassVar[float] = 5e-4  # m
    forces: ClassVar[tuple[float, float]] = (0.05, 3.0)  # N
    lower = np.array([-0.012, -0.012, 0.0024])
    upper = np.array([0.012, 0.012, 0.006])

    def indenter(self) -> Collider:
        """See `TactileEnv`."""
        return Box(self.half_extents, self.rounding, "block")

    def goal_space(self) -> dict[str, spaces.Space[Any]]:
        """See `TactileEnv`."""
        return {}

    def begin(self) -> None:
        """See `TactileEnv`."""
        self._turn = self.np_random.uniform(-np.pi, np.pi)
        # An edge along y at 1 to 2.5 mm from the middle, the block on either side of it.
        away = self.np_random.choice([-1.0, 1.0]) * self.np_random.uniform(1e-3, 2.5e-3)
        start = np.array([self.half_extents[0] + away, self.np_random.uniform(-2e-3, 2e-3)])
        self._shift = self.np_random.uniform(-2e-3, 2e-3, 2)
        c, s = np.cos(self._turn), np.sin(self._turn)
        block = np.array([[c, -s], [s, c]]) @ start
        height = self.half_extents[2] + self.np_random.uniform(2e-4, 1e-3)
        self.position, self.rotation = np.append(block - self._shift, height), np.zeros(3)

    def _pose(self) -> RigidPose:
        """Of the block, which is shifted and turned from what holds it."""
        position = self.position + np.append(self._shift, 0.0)
        return self.pad.world_pose(position, [0.0, 0.0, self._turn])

    def goal(self) -> Observation:
        """See `TactileEnv`."""
        return {}

    def outline_distance(self) -> float:
        """The signed distance of the middle of the pad from the outline of the block [m], negative below the block."""
        c, s = np.cos(self._turn), np.sin(self._turn)
        x, y = self.position[:2] + self._shift
        middle = np.array([-c * x - s * y, s * x - c * y])
        return rectangle_distance(middle, np.array(self.half_extents[:2]))

    def judged(self, seen: TactileImage) -> tuple[float, bool, dict[str, Any]]:
        """See `TactileEnv`."""
        force, distance = float(np.linalg.norm(seen.force)), self.outline_distance()
        touching = self.forces[0] < force < self.forces[1]
        reward = -min(1.0, abs(distance) / 5e-3) - (0.0 if touching else 0.5)
        info = {"force": force, "distance_mm": MILLIMETRES * distance}
        return reward, touching and abs(distance) < self.tolerance, info


def rectangle_distance(point: Array, half: Array) -> float:
    """The signed distance of a point (2,) from a rectangle about the origin, negative inside."""
    beyond = np.abs(point) - half
    return float(np.linalg.norm(np.maximum(beyond, 0.0)) + min(beyond.max(), 0.0))
