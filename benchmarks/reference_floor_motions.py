"""How far motions of full space differ when nothing differs but the facets under the collider; and models from that.

    python -m benchmarks.reference_floor_motions EXPERIMENT.toml RUN/motions/SCENE_full.h5 ... [--turns 37 101 223]

For a body of revolution whose frames are all held, without springs and friction, as the Jelly's is: to turn the
collider and its path about the axis turns the answer, but the collider meets other facets. Each motion of full space is
played again for every turn, and turned back, so that it is the same motion on another mesh of the same fineness. RMS
over the frames in which the motion in the file is in contact, as a share of its force, and in mm over all nodes:

    turned      between full space in the file and the turned ones (RMS over the turns)
    MODEL       between the motion of that model in RUN/motions and full space in the file
    from mean   between either and the mean of full space as it is and turned, n motions in all, which scatters by
                1/sqrt(n) of what one does

No model can be shown to be nearer to one motion of full space than another mesh of the same fineness is.
"""

from __future__ import annotations

import argparse
import logging
from collections.abc import Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from benchmarks.motions_alone import line, rms
from benchmarks.reference_floor import turned_back
from benchmarks.thin_shapes import about_the_axis
from softprint.fem_truth.dynamics.full_space_simulator import FullSpaceSimulator
from softprint.runtime.arrays import Array, IntArray
from softprint.runtime.body import ReducedBody, load_body
from softprint.runtime.cli.script import run_script
from softprint.runtime.colliders import RigidPose
from softprint.runtime.dynamics import DynamicsSettings, KinematicHandle, PlacedCollider
from softprint.runtime.errors import SoftprintError
from softprint.runtime.experiment import Experiment, load_experiment
from softprint.runtime.optimise import NewtonSettings
from softprint.runtime.scenes.motion_file import Motion, load_motion

log = logging.getLogger("softprint.benchmarks")


@dataclass(frozen=True, eq=False)
class Track:
    """A motion in the frames in contact. x: (n, n_nodes, 3) [m]; force: on the collider (n, 3) [N]; converged: share of
    all its steps."""

    x: Array
    force: Array
    converged: float

    def off(self, other: Track) -> Array:
        """(2,) from another: RMS of the force [N], and of the positions [m]."""
        return np.array([rms(self.force - other.force), rms(self.x - other.x)])


def of_file(motion: Motion, frames: IntArray) -> Track:
    """A motion as it is in its file."""
    (track,) = motion.colliders.values()
    x = np.array([motion.positions(frame) for frame in frames])
    return Track(x, track.force[frames], float(motion.converged[1:].mean()))


def turned(experiment: Experiment, body: ReducedBody, motion: Motion, frames: IntArray, turn: float) -> Track:
    """Full space with collider and path turned about the axis by an angle [rad], turned back."""
    rotation = about_the_axis(turn)
    ((name, collider),) = motion.build_colliders().items()
    poses = [
        {name: RigidPose(rotation @ pose.rotation, rotation @ pose.translation)}
        for pose in motion.colliders[name].poses
    ]
    own = experiment.dynamics
    simulator = FullSpaceSimulator(
        body,
        [PlacedCollider(name, collider)],
        contact=motion.contact,
        gravity=own.gravity,
        kinematic=[KinematicHandle(frame.name) for frame in body.handles.frames],
        settings=DynamicsSettings(own.time_step, NewtonSettings(own.max_iterations, own.tolerance)),
    )
    wanted, positions, forces, converged = set(frames), list[Array](), list[Array](), list[bool]()
    result = simulator.settle(simulator.rest_state(poses=poses[0]))
    for frame, pose in enumerate(poses):
        if frame:
            result = simulator.step(result.state, pose)
            converged.append(result.converged)
        if frame in wanted:
            positions.append(simulator.positions(result.state))
            forces.append(result.contacts[name].force)
    x = turned_back(np.array(positions), body.mesh, turn)
    return Track(x, np.array(forces) @ rotation, float(np.mean(converged)))


def figures(
    experiment: Experiment, run: Path, turns: Sequence[float], models: Sequence[str], path: Path
) -> tuple[str, float, Mapping[str, Array]]:
    """The scene of a motion, the force in it [N], and what is off by line of the module (2,): share of it, and mm."""
    motion, body = load_motion(path), load_body(run / "body.h5")
    if len(motion.colliders) != 1:
        raise SoftprintError(f"{path}: is of {len(motion.colliders)} colliders: give motions with one")
    frames = np.flatnonzero(motion.in_contact)
    if not frames.size:
        raise SoftprintError(f"{path}: nothing is touched in this motion")
    full = of_file(motion, frames)
    others = [turned(experiment, body, motion, frames, np.radians(turn)) for turn in turns]
    every = [full, *others]
    mean = Track(
        np.mean([own.x for own in every], axis=0), np.mean([own.force for own in every], axis=0), 1.0
    )
    force = rms(full.force)
    unit = np.array([1.0 / force, 1e3])
    off = {"turned": np.sqrt(np.mean([np.square(own.off(full)) for own in others], axis=0)) * unit}
    off["full space from mean"] = full.off(mean) * unit
    for model in models:
        own = of_file(load_motion(path.with_name(f"{motion.scene}_{model}.h5")), frames)
        off[model], off[f"{model} from mean"] = own.off(full) * unit, own.off(mean) * unit
    if min(own.converged for own in every) < 1.0:
        shares = ", ".join(f"{own.converged:.1%}" for own in every)
        log.warning("%s: of the steps of full space, as it is and turned, %s converged", motion.scene, shares)
    return motion.scene, force, off


def main(arguments: Sequence[str] | None = None) -> None:
    """Prints a table in Markdown, row by row, and the RMS over the motions."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("experiment", type=Path, metavar="EXPERIMENT.toml")
    parser.add_argument("motions", type=Path, nargs="+", metavar="FULL.h5")
    parser.add_argument("--out", type=Path, default=None, metavar="RUN", help="default: runs/NAME")
    parser.add_argument("--models", nargs="+", default=["mechanics", "ours"], metavar="NAME")
    parser.add_argument("--turns", type=float, nargs="+", default=[37.0, 101.0, 223.0], help="degrees")
    parser.add_argument("--processes", type=int, default=1, help="motions at a time (default: 1)")
    options = parser.parse_args(arguments)
    run = options.out or Path("runs") / options.experiment.stem
    experiment = load_experiment(options.experiment)
    if experiment.contact.friction:
        raise SoftprintError(
            f"{options.experiment}: contact is rough, and full space is turned without friction"
        )
    one = partial(figures, experiment, run, options.turns, options.models)
    rows = list[Array]()
    with ProcessPoolExecutor(options.processes) as pool:
        for scene, force, off in pool.map(one, options.motions):
            if not rows:
                print(line("motion", "force, N", *(f"{name}: share, mm" for name in off)))
                print("| --- " * (len(off) + 2) + "|")
            rows.append(np.array(list(off.values())))
            print(
                line(scene, f"{force:.2f}", *(f"{share:.1%}, {mm:.3f}" for share, mm in rows[-1])), flush=True
            )
    overall = np.sqrt(np.mean(np.square(rows), axis=0))
    print(line("RMS over motions", "", *(f"{share:.1%}, {mm:.3f}" for share, mm in overall)))


if __name__ == "__main__":
    run_script(main)
