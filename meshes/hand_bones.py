"""The sixteen bones of the Hand: a palm, which is wrist and metacarpals, and three for each finger."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from hand_skin import Skin

from softprint.runtime.arrays import Array

FINGERS = ("thumb", "index", "middle", "ring", "pinky")
# Joints of a finger's bones from the palm outwards, and after them its tip.
JOINTS = {
    "thumb": ("metacarpal", "phalanx-proximal", "phalanx-distal", "tip"),
    "finger": ("phalanx-proximal", "phalanx-intermediate", "phalanx-distal", "tip"),
}
RADIUS = 0.0034  # of the bones of a finger [m]
STOUT = 1.5  # times that: the bones of the palm, and the thumb's first
GAP = 0.0024  # left at a joint between bones, beyond their radius, so that the flesh there can bend [m]


class Bone(NamedTuple):
    """segments: pairs of ends (3,) [m]; radius [m] about them."""

    segments: list[tuple[Array, Array]]
    radius: float


def kind(finger: str) -> str:
    return "thumb" if finger == "thumb" else "finger"


def joint(skin: Skin, finger: str, number: int) -> Array:
    """(3,) of a finger, counted from the palm; 3 is its tip [m]."""
    prefix = "thumb" if finger == "thumb" else f"{finger}-finger"
    return skin.joints[f"{prefix}-{JOINTS[kind(finger)][number]}"]


def anchors(skin: Skin) -> dict[str, Array]:
    """The joint on the palm's side of each bone; the palm's is the wrist."""
    outer = {f"{finger}_{n + 1}": joint(skin, finger, n) for finger in FINGERS for n in range(3)}
    return {"palm": skin.joints["wrist"], **outer}


def bones(skin: Skin) -> dict[str, Bone]:
    found = {"palm": _palm(skin)}
    for finger in FINGERS:
        for n in range(3):
            radius = STOUT * RADIUS if (finger, n) == ("thumb", 0) else RADIUS
            gap = radius + GAP
            ends = _shortened(joint(skin, finger, n), joint(skin, finger, n + 1), gap, 0.0 if n == 2 else gap)
            found[f"{finger}_{n + 1}"] = Bone([ends], radius)
    return found


def _palm(skin: Skin) -> Bone:
    radius = STOUT * RADIUS
    roots = {finger: skin.joints[f"{finger}-finger-metacarpal"] for finger in FINGERS[1:]}
    ends = [_shortened(root, joint(skin, finger, 0), 0.0, radius + GAP) for finger, root in roots.items()]
    return Bone([*ends, (skin.joints["wrist"], roots["middle"])], radius)


def _shortened(start: Array, end: Array, before: float, behind: float) -> tuple[Array, Array]:
    along = (end - start) / np.linalg.norm(end - start)
    return start + before * along, end - behind * along


def marrow(skin: Skin, pitch: float) -> Array:
    """(n, 3) points along the middles of the bones, at most a pitch apart [m]."""
    lines = [segment for bone in bones(skin).values() for segment in bone.segments]
    return np.vstack([np.linspace(a, b, 2 + int(np.linalg.norm(b - a) / pitch)) for a, b in lines])
