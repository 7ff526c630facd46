"""Write the recorded motions of the Hand, `hand_grasp.csv`, `hand_explore.csv`, `hand_flat.csv` and `hand_turn.csv`,
and say where its bones are.

    python meshes/hand_motion.py [--package FOLDER] [--bones] [FOLDER]

The motions are played by a skeleton, the joints of `hand_skin.py`: a palm, and three bones for each finger that bend
together. Each is sampled fifteen times a second, as a tracker would. `--bones` prints the rigid frames of an
experiment instead.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from hand_bones import FINGERS, anchors, bones, joint, kind
from hand_skin import Skin, read_skin
from scipy.interpolate import PchipInterpolator
from scipy.spatial.transform import Rotation

from softprint.runtime.arrays import Array
from softprint.runtime.cli.script import run_script
from softprint.runtime.colliders import RigidPose
from softprint.runtime.experiment.recorded_motion import COLUMNS
from softprint.runtime.io.files import atomic_path

RATE = 15.0  # samples a second
# How far the bones of a finger turn, from the palm outwards, for a bend of one.
SHARES = {"thumb": (0.5, 0.7, 0.8), "finger": (0.9, 1.0, 0.65)}
THUMB_TOWARDS = (0.25, -0.8, -0.55)  # where a thumb that closes goes

# Time [s], displacement of the palm [m], its rotation about the wrist [rad], bend of thumb to little finger [rad].
Keyframe = tuple[float, tuple[float, float, float], tuple[float, float, float], tuple[float, ...]]
MOTIONS: dict[str, Sequence[Keyframe]] = {
    # Down onto an object below the fingers, round it, and off again.
    "hand_grasp": (
        (0.0, (0, 0, 0), (0, 0, 0), (0.0, 0.0, 0.0, 0.0, 0.0)),
        (0.8, (0, 0, -0.012), (0, 0, 0), (0.1, 0.2, 0.2, 0.2, 0.2)),
        (1.4, (0, 0, -0.018), (0, 0, 0), (0.4, 0.55, 0.55, 0.55, 0.5)),
        (2.0, (0, 0, -0.018), (0, 0, 0.12), (0.45, 0.65, 0.6, 0.6, 0.6)),
        (2.6, (0, 0, -0.016), (0, 0.05, -0.12), (0.4, 0.6, 0.65, 0.6, 0.5)),
        (3.2, (0, 0, 0.005), (0, 0, 0), (0.1, 0.1, 0.1, 0.1, 0.1)),
    ),
    # Finger by finger over an object, with the palm swaying.
    "hand_explore": (
        (0.0, (0, 0, 0), (0, 0, 0), (0.0, 0.0, 0.0, 0.0, 0.0)),
        (0.6, (0, 0.004, -0.010), (0, 0, 0.10), (0.1, 0.35, 0.2, 0.1, 0.1)),
        (1.0, (0, 0.004, -0.014), (0, 0, 0.16), (0.3, 0.62, 0.4, 0.25, 0.2)),
        (1.4, (0.002, 0, -0.014), (0, 0, 0.06), (0.4, 0.45, 0.62, 0.45, 0.3)),
        (1.8, (0.002, -0.003, -0.014), (0, 0, -0.06), (0.3, 0.5, 0.5, 0.62, 0.5)),
        (2.2, (0.004, -0.003, -0.016), (0.08, 0, -0.14), (0.45, 0.6, 0.45, 0.5, 0.62)),
        (2.6, (0, 0, -0.016), (0, 0.05, 0), (0.5, 0.65, 0.65, 0.6, 0.6)),
        (3.2, (0, 0, 0.005), (0, 0, 0), (0.1, 0.1, 0.1, 0.1, 0.1)),
    ),
    # Flat and still: the one pose to learn from.
    "hand_flat": (
        (0.0, (0, 0, 0), (0, 0, 0), (0.0, 0.0, 0.0, 0.0, 0.0)),
        (0.4, (0, 0, 0), (0, 0, 0), (0.0, 0.0, 0.0, 0.0, 0.0)),
    ),
    # Palm up, with an object on it: the fingers close on it and roll it to and fro, one side after the other.
    "hand_turn": (
        (0.0, (0, 0, 0), (0, 0, 0), (0.0, 0.0, 0.0, 0.0, 0.0)),
        (0.4, (0, 0, 0), (0, 0, 0), (0.1, 0.15, 0.15, 0.15, 0.15)),
        (0.9, (0, 0, 0), (0, 0, 0), (0.3, 0.6, 0.55, 0.5, 0.45)),
        (1.3, (0, 0, 0), (0.15, 0, 0), (0.5, 0.8, 0.55, 0.35, 0.3)),
        (1.7, (0, 0, 0), (-0.15, 0, 0), (0.3, 0.4, 0.6, 0.75, 0.8)),
        (2.0, (0, 0, 0), (0, -0.1, 0), (0.4, 0.7, 0.7, 0.6, 0.5)),
        (2.4, (0, 0, 0), (0, 0, 0), (0.1, 0.2, 0.2, 0.2, 0.2)),
    ),
}


def bend_axis(skin: Skin, finger: str) -> Array:
    """(3,) about which a finger closes: across, and square to it, for all but the thumb."""
    along = joint(skin, finger, 3) - joint(skin, finger, 0)
    axis = np.cross(along, THUMB_TOWARDS if finger == "thumb" else (0.0, 0.0, -1.0))
    return axis / np.linalg.norm(axis)


def skeleton(skin: Skin, palm: RigidPose, bends: Array) -> dict[str, RigidPose]:
    """Poses that take the bones from rest to where they are: palm: that of the palm; bends: (5,) [rad]."""
    poses = {"palm": palm}
    for finger, bend in zip(FINGERS, bends):
        pose, axis = palm, bend_axis(skin, finger)
        for number, share in enumerate(SHARES[kind(finger)]):
            pose = pose.compose(about(joint(skin, finger, number), bend * share * axis))
            poses[f"{finger}_{number + 1}"] = pose
    return poses


def about(centre: Array, turn: Array) -> RigidPose:
    """A rotation vector about a point that stays."""
    rotation = Rotation.from_rotvec(turn).as_matrix()
    return RigidPose(rotation, centre - rotation @ centre)


def recorded(skin: Skin, keyframes: Sequence[Keyframe]) -> list[str]:
    """The lines of the table."""
    key_times = [keyframe[0] for keyframe in keyframes]
    played = PchipInterpolator(key_times, [np.concatenate(keyframe[1:]) for keyframe in keyframes])
    wrist, tracked = skin.joints["wrist"], anchors(skin)
    lines = {name: list[str]() for name in tracked}
    for time in np.arange(0.0, key_times[-1] + 0.5 / RATE, 1.0 / RATE):
        now = played(min(time, key_times[-1]))
        turned = about(wrist, now[3:6])
        palm = RigidPose(turned.rotation, turned.translation + now[:3])
        for name, pose in skeleton(skin, palm, now[6:]).items():
            place = pose.apply(tracked[name][None])[0]
            lines[name].append(
                ",".join([name, f"{time:.4f}", *(f"{v:.5f}" for v in (*place, *pose.rotation_vector))])
            )
    return [",".join(COLUMNS[3]), *(line for track in lines.values() for line in track)]


def frames(skin: Skin) -> list[str]:
    """The bones as tables of an experiment."""
    lines = []
    for name, bone in bones(skin).items():
        written = [f"[{point(start)}, {point(end)}]" for start, end in bone.segments]
        if len(written) > 1:
            written = ["", *(f"    {segment}," for segment in written), ""]
        segments = "\n".join(written)
        lines += [f'[[body.handles.frames]]\nname = "{name}"', f"segments = [{segments}]"]
        lines += [f"radius = {bone.radius:g}"]
    return lines


def point(place: Array) -> str:
    return "[" + ", ".join(f"{v:.4f}" for v in place) + "]"


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--package", type=Path, help="folder that holds the npm package, or is to hold it")
    parser.add_argument("--bones", action="store_true", help="print the bones as frames of an experiment")
    parser.add_argument("folder", type=Path, nargs="?", default=Path(__file__).parent)
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as scratch:
        skin = read_skin(arguments.package or Path(scratch))
    if arguments.bones:
        print("\n".join(frames(skin)))
        return
    for name, keyframes in MOTIONS.items():
        with atomic_path(arguments.folder / f"{name}.csv") as temporary:
            temporary.write_text("\n".join(recorded(skin, keyframes)) + "\n", encoding="utf-8")


if __name__ == "__main__":
    run_script(main)
