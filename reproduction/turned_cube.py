"""How the Hand turns the free cube, by every model alone (thesis, figure 5.1).

    softprint run examples/hand_cube_small.toml
    python -m reproduction.turned_cube examples/hand_cube_small.toml

Needs the motions of the scene `turn`. A table in Markdown:

    turned     largest angle of the cube from its start [degrees]
    off        distance of the cube from that of full space [mm], and angle between them [degrees], RMS over frames
    inside     how deep the cube is in the hand at most [mm]
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from softprint.fem_truth.report.run_files import find_run_files, load_motions
from softprint.runtime.cli.context import Context
from softprint.runtime.cli.run_body import body_of_run
from softprint.runtime.cli.script import run_script
from softprint.runtime.colliders.pose import RigidPose
from softprint.runtime.errors import SoftprintError
from softprint.runtime.experiment.experiment import FULL
from softprint.runtime.scenes.motion_file import Motion
from softprint.runtime.scenes.scene import find_scene

SCENE, CUBE = "turn", "cube"


def angle(one: RigidPose, other: RigidPose) -> float:
    """Between two poses [degrees]."""
    turn = RigidPose(one.rotation.T @ other.rotation, np.zeros(len(one.translation)))
    return float(np.degrees(np.linalg.norm(turn.rotation_vector)))


def cells(name: str, motion: Motion, full: Motion) -> list[str]:
    """One line of the table."""
    track, poses = motion.colliders[CUBE], motion.colliders[CUBE].poses
    pairs = list(zip(poses, full.colliders[CUBE].poses, strict=True))
    off = np.sqrt(np.mean([np.sum((a.translation - b.translation) ** 2) for a, b in pairs]))
    turned = np.sqrt(np.mean([angle(a, b) ** 2 for a, b in pairs]))
    most = max(angle(poses[0], pose) for pose in poses)
    inside = 1e3 * np.nanmax(track.intrusion)
    return [name, f"{most:.1f}", f"{1e3 * off:.2f}, {turned:.1f}", f"{inside:.2f}"]


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("experiment", type=Path)
    parser.add_argument("--out", type=Path, help="run directory (default: runs/NAME)")
    given = parser.parse_args()
    context = Context(experiment_path=given.experiment, out=given.out, quiet=True)
    try:
        files, body = find_run_files(context.out_dir, context.experiment), body_of_run(context)
        motions = load_motions(files, context.experiment, find_scene(context.experiment, SCENE), body)
        if FULL not in motions:
            raise SoftprintError(f"{SCENE!r} has no motion of full space: softprint simulate --scene {SCENE}")
    except SoftprintError as error:
        parser.error(str(error))
    rows = [cells(name, motion, motions[FULL]) for name, motion in motions.items()]
    for row in (["model", "turned", "off", "inside"], ["---"] * 4, *rows):
        print(f"| {' | '.join(row)} |")


if __name__ == "__main__":
    run_script(main)
