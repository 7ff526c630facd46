"""The environments of a tactile pad: how fast they are, how far from full space, and whether their tasks are learnable.

    python -m benchmarks.tactile_environment [EXPERIMENT] [--models bare mechanics ours] [--episodes 5]

For both tasks: the share of episodes that a scripted and a random policy solve, with the first model but bare; and for
every model, actions a second (an action is two time steps, the observation is in it) of the scripted episodes, replayed
with the same poses of the indenter by all models and in full space, and how far force and displacement of the markers
are off then:

    sqrt(sum |f - f_full|^2 / sum |f_full|^2),    sqrt(sum |u - u_full|^2 / sum |u_full|^2)

Without an experiment the pad is the coarse one that needs no files. Needs DOLFINx, and for `ours` a trained experiment.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np

from softprint.fem_truth.dynamics.full_space_simulator import FullSpaceSimulator
from softprint.runtime.arrays import Array, IntArray
from softprint.runtime.cli.script import run_script
from softprint.runtime.colliders import RigidPose
from softprint.runtime.environments import FindEdgeEnv, PressToForceEnv
from softprint.runtime.environments.scripted import find_edge, press_to_force
from softprint.runtime.environments.tactile_environment import TactileEnv
from softprint.runtime.environments.tactile_pad import INDENTER, TactilePad
from softprint.runtime.touch import TactileCamera

SENSES = ("markers", "depth", "force")
Policy = Callable[..., Any]
TASKS: dict[str, tuple[type[TactileEnv], Policy]] = {
    "press to force": (PressToForceEnv, press_to_force),
    "find edge": (FindEdgeEnv, find_edge),
}


class Played(NamedTuple):
    """Forces (n, 3) [N] and markers (n, m, 3) [m] after every time step, and steps that did not converge."""

    forces: Array
    markers: Array
    failed: int


def episodes(
    env: TactileEnv, policy: Policy | None, seeds: Sequence[int]
) -> tuple[float, list[list[RigidPose]]]:
    """The share of solved episodes of a policy, None for random actions, and the poses of each."""
    solved, poses = 0, []
    env.action_space.seed(0)
    for seed in seeds:
        seen, info = env.reset(seed=seed)
        over = False
        while not over:
            action = env.action_space.sample() if policy is None else policy(env, seen)
            seen, _, done, stopped, info = env.step(action)
            over = done or stopped
        solved += info["success"]
        poses.append(env.poses)
    return solved / len(seeds), poses


def replayed(pad: TactilePad, poses: Sequence[RigidPose]) -> Played:
    """The same poses with the model of a pad."""
    return _played(pad.start, pad.step, pad.camera, poses)


class FullSpace:
    """A pad in full space, with the same camera."""

    def __init__(self, env: TactileEnv, markers: Sequence[int], image: Sequence[int]) -> None:
        parts = env.pad.parts
        self.simulator = FullSpaceSimulator(
            parts.body,
            [parts.placed(env.indenter())],
            contact=parts.contact,
            friction=parts.friction,
            gravity=parts.gravity,
            kinematic=parts.held,
            settings=parts.settings,
        )
        self.camera = TactileCamera(self, parts.body, markers=markers, image=image)

    def follow(self, nodes: IntArray) -> Callable[[Any], Array]:
        """As of `Simulator`."""
        return lambda state: np.asarray(state.x[nodes])

    def replayed(self, poses: Sequence[RigidPose]) -> Played:
        """The same poses."""
        start = lambda pose: self.simulator.settle(self.simulator.rest_state(poses={INDENTER: pose}))  # noqa: E731
        return _played(
            start, lambda state, pose: self.simulator.step(state, {INDENTER: pose}), self.camera, poses
        )


def _played(
    start: Callable[[RigidPose], Any],
    step: Callable[[Any, RigidPose], Any],
    camera: TactileCamera,
    poses: Sequence[RigidPose],
) -> Played:
    result, images, failed = start(poses[0]), [], 0
    for pose in poses[1:]:
        result = step(result.state, pose)
        failed += not result.converged
        images.append(camera.see(result))
    return Played(np.array([i.force for i in images]), np.array([i.markers for i in images]), failed)


def off(found: Array, true: Array) -> float:
    """sqrt(sum |found - true|^2 / sum |true|^2)."""
    return float(np.linalg.norm(found - true) / np.linalg.norm(true))


def compare(task: str, given: argparse.Namespace) -> None:
    """Print the rows of one task."""
    make, policy = TASKS[task]
    sizes = {"markers": (12, 9), "image": (64, 48)}
    envs = {
        name: make(given.experiment, given.out, name, observe=SENSES, max_steps=given.max_steps, **sizes)  # type: ignore[arg-type]
        for name in given.models
    }
    judge = next((name for name in given.models if name != "bare"), given.models[0])
    seeds = range(given.episodes)
    scripted, sequences = episodes(envs[judge], policy, seeds)
    random, _ = episodes(envs[judge], None, seeds)
    print(
        f"{task}, {judge}, {given.episodes} episodes: scripted policy solves {scripted:.0%}, random {random:.0%}",
        flush=True,
    )
    full = FullSpace(envs[judge], **sizes)
    started = time.perf_counter()
    true = [full.replayed(poses) for poses in sequences]
    _row("full", true, true, time.perf_counter() - started, envs[judge].repeat)
    for name, env in envs.items():
        replayed(env.pad, sequences[0][:4])  # what is prepared at its first use
        started = time.perf_counter()
        found = [replayed(env.pad, poses) for poses in sequences]
        _row(name, found, true, time.perf_counter() - started, env.repeat)


def _row(name: str, found: Sequence[Played], true: Sequence[Played], seconds: float, repeat: int) -> None:
    """One model."""
    forces, markers, failed = (np.concatenate([np.atleast_1d(p[k]) for p in found]) for k in range(3))
    true_forces, true_markers = (np.concatenate([p[k] for p in true]) for k in range(2))
    print(
        f"  {name:10s} {len(forces) / repeat / seconds:8.1f} actions/s   force off {off(forces, true_forces):7.1%}   "
        f"markers off {off(markers, true_markers):7.1%}   {int(failed.sum())} of {len(forces)} steps not converged",
        flush=True,
    )


def main() -> None:
    """Compare both tasks."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("experiment", nargs="?", metavar="EXPERIMENT", help="default: the pad without files")
    parser.add_argument("--out", metavar="RUN", help="its run directory (default: runs/NAME)")
    parser.add_argument("--models", nargs="+", default=["bare", "mechanics"], metavar="NAME")
    parser.add_argument("--episodes", type=int, default=5)
    parser.add_argument("--max-steps", type=int, default=100, help="actions of an episode")
    parser.add_argument("--tasks", nargs="+", choices=list(TASKS), default=list(TASKS))
    given = parser.parse_args()
    for task in given.tasks:
        compare(task, given)


if __name__ == "__main__":
    run_script(main)
