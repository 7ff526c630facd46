"""What is linear mechanics worth at the states of a motion? Force and displacement by contact, against full space.

    python -m reproduction.linear_response EXPERIMENT SCENE [SCENE ...] [--out RUN] [--frames 12]

SCENE is a scene of the experiment, or SCENE=SHAPE for one with another shape of the library in the place of its
collider; each needs its motion in full space, and the run its mechanics (`softprint mechanics`). At the state of some
frames in contact the collider comes from outside, against the force on it, in 8 steps of 1 mm. Compared with full space
held at that state are its elasticity linearised about the state without contact, and linear mechanics, whose compliance
is that of the body at rest, carried along by its rotations. In Markdown, over the frames of each motion:

    force           sqrt(sum |f - f_full|^2 / sum |f_full|^2): f moves the body as a whole
    displacement    sqrt(sum |u - u_full|^2 / sum |u_full|^2): u by contact, at all nodes
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from reproduction.confidence_check import scene_of
from softprint.fem_truth.elasticity.full_space_elasticity import FullSpaceElasticity
from softprint.fem_truth.report.measurements.comparison import evenly_spaced
from softprint.fem_truth.statics.constrained import ConstrainedProblem, Press, Solution
from softprint.runtime.arrays import Array
from softprint.runtime.body.body import ReducedBody
from softprint.runtime.cli.context import Context
from softprint.runtime.cli.run_body import body_of_run
from softprint.runtime.cli.script import run_script
from softprint.runtime.colliders.collider import Collider
from softprint.runtime.colliders.pose import RigidPose
from softprint.runtime.contact import PenaltyContact
from softprint.runtime.dynamics.handle_forces import StaticContact
from softprint.runtime.dynamics.placed_collider import PlacedCollider
from softprint.runtime.errors import SoftprintError
from softprint.runtime.experiment.schema.training import ModelSpec
from softprint.runtime.learned.force.correction import ForceCorrection
from softprint.runtime.learned.force.entry import options
from softprint.runtime.learned.force.model import ForceModel
from softprint.runtime.learned.static_correction import StaticCorrection
from softprint.runtime.mechanics.body_mechanics import BodyMechanics
from softprint.runtime.mechanics.mechanics_file import load_mechanics, mechanics_path
from softprint.runtime.scenes.motion_file import load_motion
from softprint.runtime.scenes.scene import scene_parts
from softprint.runtime.scenes.simulate import motion_path

# How far from outside a collider comes [m], and in how many steps.
FAR, STEPS = 0.008, 8


class Answer(NamedTuple):
    """force: on the body (dim,) [N]; displacement: by contact (n_nodes, dim) [m]."""

    force: Array
    displacement: Array


class Judge:
    """Full space held at states, with one collider."""

    def __init__(self, body: ReducedBody, collider: Collider, law: PenaltyContact, gravity: Array) -> None:
        self._body, self._collider = body, collider
        self._problem = ConstrainedProblem(FullSpaceElasticity(body), gravity, law, body)

    def answers(self, rows: Array, way: Sequence[RigidPose]) -> tuple[Answer, Answer] | None:
        """That of full space, and of its linearisation; None where a solve has failed."""
        internal = self._problem.internal_equilibrium(rows)
        full, linear = (
            _pressed(press(rows, self._collider, internal.x), way)
            for press in (self._problem.press, self._problem.linear_press)
        )
        if not (internal.converged and full.converged and linear.converged):
            return None
        whole = self._body.handles.affine_part
        exact, response = (
            Answer(whole @ (found.handle_force - internal.handle_force), found.x - internal.x)
            for found in (full, linear)
        )
        return exact, response


class Mechanics:
    """Linear mechanics of a body, with one collider."""

    def __init__(
        self, body: ReducedBody, collider: Collider, law: PenaltyContact, mechanics: BodyMechanics
    ) -> None:
        model = ForceModel(options(ModelSpec(name="mechanics"), body, law), body.dim, body.n_rows)
        correction = ForceCorrection("mechanics", model, body, collider, mechanics)
        placed = PlacedCollider(collider.name, collider, correction=correction)
        self._name, self._whole = collider.name, body.handles.affine_part
        self._drawn = StaticCorrection(correction, body)
        self._contact = StaticContact(body, [placed], law, mechanics)

    def answer(self, rows: Array, way: Sequence[RigidPose]) -> Answer:
        """At a state."""
        force = self._contact.handle_force(rows, [{self._name: pose} for pose in way])
        return Answer(self._whole @ force, self._drawn.displacement_along(rows, way))


def _pressed(press: Press, way: Sequence[RigidPose]) -> Solution:
    return [press.solve(pose) for pose in way][-1]


def measured(context: Context, body: ReducedBody, option: str, n_frames: int) -> str:
    """The line of one motion."""
    experiment, scene = scene_of(context.experiment, option)
    (placed,) = scene_parts(experiment, scene).colliders
    path, law = motion_path(context.out_dir, scene.name, "full"), PenaltyContact.of(experiment.contact)
    if not path.is_file():
        raise SoftprintError(f"{path}: no such motion; make it with softprint simulate --model full")
    motion, known = load_motion(path), load_mechanics(mechanics_path(context.out_dir, 3000), body)
    judge = Judge(body, placed.collider, law, np.array(experiment.dynamics.gravity))
    mechanics, found = Mechanics(body, placed.collider, law, known), []
    track = motion.colliders[placed.name]
    for frame in evenly_spaced(np.flatnonzero(motion.in_contact), n_frames):
        rows, pose, along = body.project(motion.positions(frame)), track.poses[frame], track.force[frame]
        back = along / np.linalg.norm(along)
        way = [
            RigidPose(pose.rotation, pose.translation + s * back) for s in np.linspace(FAR, 0.0, STEPS + 1)
        ]
        answers = judge.answers(rows, way)
        if answers is not None:
            found.append((*answers, mechanics.answer(rows, way)))
    if not found:
        raise SoftprintError(f"{path}: full space has no solution at any of the frames in contact")
    cells = [option, str(len(found))]
    for part in Answer._fields:
        exact, *others = (
            np.array([getattr(own, part) for own in column]) for column in zip(*found, strict=True)
        )
        size = np.linalg.norm(exact)
        cells += [f"{np.linalg.norm(other - exact) / size:.1%}" for other in others]
    return "| " + " | ".join(cells) + " |"


def main(words: Sequence[str] | None = None) -> None:
    """Prints a table in Markdown, row by row."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("experiment", type=Path)
    parser.add_argument("scenes", nargs="+", metavar="SCENE")
    parser.add_argument("--out", type=Path, help="run directory (default: runs/NAME)")
    parser.add_argument("--frames", type=int, default=12, help="of each motion at most (default: 12)")
    given = parser.parse_args(words)
    context = Context(experiment_path=given.experiment, out=given.out, quiet=True)
    body = body_of_run(context)
    print(
        "| motion | frames | force: linearised at the state | mechanics | displacement: linearised | mechanics |"
    )
    print("| --- " * 6 + "|", flush=True)
    for option in given.scenes:
        print(measured(context, body, option, given.frames), flush=True)


if __name__ == "__main__":
    run_script(main)
