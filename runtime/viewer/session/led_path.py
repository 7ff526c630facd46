"""The path of something that is led by hand: wherever it is now."""

from __future__ import annotations

from softprint.runtime.colliders.path import KeyframedPath
from softprint.runtime.colliders.pose import RigidPose
from softprint.runtime.viewer.session.follower import Follower


class LedPath(KeyframedPath):
    """A path whose pose at any time is that of a `Follower`, for springs and kinematic handles of an interactive
    session, which steps forward only."""

    def __init__(self, follower: Follower) -> None:
        pose = follower.pose
        super().__init__([0.0], pose.translation[None], pose.rotation_vector[None])
        self.follower = follower

    def pose(self, time: float) -> RigidPose:
        """The follower's."""
        return self.follower.pose
