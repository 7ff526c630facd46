"""A pose that follows a target smoothly and at limited speed.

Drag events come some 20 to 60 times a second, unevenly, and a mouse may jump. In every step of h seconds the pose goes
the fraction 1 - exp(-h / tau) of its way, and no faster than the limits.
"""

from __future__ import annotations

import numpy as np

from softprint.runtime.colliders.pose import RigidPose, rotation_matrix

LAG = 0.02  # tau [s]
SPIN = 6.0  # rad/s, the limit of turning


class Follower:
    """pose: where it is now; target: where it is wanted; speed: its limit [m/s]."""

    def __init__(self, pose: RigidPose, speed: float) -> None:
        self.pose = self.target = pose
        self.speed = speed

    def jump(self, pose: RigidPose) -> None:
        """Be at a pose at once."""
        self.pose = self.target = pose

    def advance(self, seconds: float) -> RigidPose:
        """The pose after so many seconds."""
        if self.pose is self.target:
            return self.pose
        share = 1.0 - np.exp(-seconds / LAG)
        way = self.target.translation - self.pose.translation
        turn = self.target.compose(self.pose.inverse()).rotation_vector
        distance, angle = float(np.linalg.norm(way)), float(np.linalg.norm(turn))
        shares = [share]
        if distance * share > self.speed * seconds:
            shares.append(self.speed * seconds / distance)
        if angle * share > SPIN * seconds:
            shares.append(SPIN * seconds / angle)
        share = min(shares)
        # Close enough: a millionth of a step of the limit.
        if (1.0 - share) * distance < 1e-6 * self.speed and (1.0 - share) * angle < 1e-6:
            self.pose = self.target
            return self.pose
        rotation = rotation_matrix(share * turn, self.pose.dim) @ self.pose.rotation
        self.pose = RigidPose.known(rotation, self.pose.translation + share * way)
        return self.pose
