"""The task to press with a wanted force: a ball of 4 mm radius above the pad, somewhere over its middle.

Observation, beside those of `tactile_environment.py`: ``target`` (1,), the wanted force [N], drawn from 0.1 to 0.8 N.
The force F of the pad on the ball has to stay within 5 % of it for ten actions in a row.

Reward of an action: -min(1, |F - F*| / F*), and 10 for success.
"""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np
from gymnasium import spaces

from softprint.runtime.colliders import Collider, Sphere
from softprint.runtime.environments.tactile_environment import Observation, TactileEnv
from softprint.runtime.touch.tactile_camera import TactileImage


class PressToForceEnv(TactileEnv):
    """See the module."""

    radius: ClassVar[float] = 0.004  # m
    forces: ClassVar[tuple[float, float]] = (0.1, 0.8)  # N, wanted
    tolerance: ClassVar[float] = 0.05
    lower = np.array([-0.008, -0.006, 0.0027])
    upper = np.array([0.008, 0.006, 0.007])

    def indenter(self) -> Collider:
        """See `TactileEnv`."""
        return Sphere(self.radius, 3, "ball")

    def goal_space(self) -> dict[str, spaces.Space[Any]]:
        """See `TactileEnv`."""
        return {"target": spaces.Box(self.forces[0], self.forces[1], (1,), np.float32)}

    def begin(self) -> None:
        """See `TactileEnv`."""
        self.target = float(np.float32(self.np_random.uniform(*self.forces)))
        place = self.np_random.uniform([-0.006, -0.004], [0.006, 0.004])
        self.position = np.append(place, self.radius + self.np_random.uniform(2e-4, 1.5e-3))
        self.rotation = np.zeros(3)

    def goal(self) -> Observation:
        """See `TactileEnv`."""
        return {"target": np.clip([self.target], *self.forces).astype(np.float32)}

    def judged(self, seen: TactileImage) -> tuple[float, bool, dict[str, Any]]:
        """See `TactileEnv`."""
        force = float(np.linalg.norm(seen.force))
        error = abs(force - self.target) / self.target
        return -min(1.0, error), error < self.tolerance, {"force": force, "error": error}
