"""Local collider descriptors: the neighbourhood of a point (thesis 6.2), in collider coordinates."""

from softprint.runtime.learned.thesis6.descriptors.ball_rule import ball_rule, sample_pattern
from softprint.runtime.learned.thesis6.descriptors.contact_frame import (
    Frames,
    MovingFrames,
    biased_frames,
    moving_frames,
    random_frames,
)
from softprint.runtime.learned.thesis6.descriptors.geometry import DirectGeometry, Geometry, GridGeometry
from softprint.runtime.learned.thesis6.descriptors.local_descriptor import LocalDescriptor
from softprint.runtime.learned.thesis6.descriptors.radius import handle_spacing
from softprint.runtime.learned.thesis6.descriptors.smoothed_gradient import SmoothedGradient

__all__ = [
    "DirectGeometry",
    "Frames",
    "Geometry",
    "GridGeometry",
    "LocalDescriptor",
    "MovingFrames",
    "SmoothedGradient",
    "ball_rule",
    "biased_frames",
    "handle_spacing",
    "moving_frames",
    "random_frames",
    "sample_pattern",
]
