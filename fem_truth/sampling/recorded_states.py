"""States for contact samples: frames of recorded dynamics, spread by farthest point (thesis 5.3.2).

The scenes with ``role = "record"`` are run with the bare reduced model, with static condensation, or in full space and
projected to the subspace (thesis, figure 4.7). Internal corrections need one of the last two: a bare subspace that
locks does not go where the body would.
States come from dynamics and not from noise, because a random handle state can be at a saddle point, from which the
lightest contact makes the body snap. States for internal corrections are also disturbed, since a correction has to
know its derivatives in every direction.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from softprint.fem_truth.dynamics.full_space_model import full_space_model
from softprint.fem_truth.sampling.farthest import farthest_selection
from softprint.fem_truth.sampling.rigid_free import RigidFreeDescriptor
from softprint.runtime.arrays import Array, IntArray
from softprint.runtime.body.body import ReducedBody
from softprint.runtime.errors import SoftprintError
from softprint.runtime.scenes.playing import SceneModel, bare_model, condensed_model, play
from softprint.runtime.scenes.scene import scene_steps

if TYPE_CHECKING:
    from softprint.runtime.experiment import Experiment, SceneSpec


@dataclass(frozen=True, eq=False)
class Recording:
    """All frames of all recorded scenes.

    rows: (n, n_rows, dim); scene: n names; frame: (n,) number within its scene; time: (n,) [s].
    """

    rows: Array
    scene: list[str]
    frame: IntArray
    time: Array


def n_frames(experiment: Experiment) -> int:
    """How many frames `record_scenes` simulates."""
    return sum(1 + scene_steps(experiment, scene) for scene in experiment.scenes_of_role("record"))


def record_scenes(
    experiment: Experiment, body: ReducedBody, progress: Callable[[int], None] = lambda n: None
) -> Recording:
    """Simulate every scene with ``role = "record"``, with the model of `sampling.record_with`; raises SoftprintError
    if there is none. progress(1) is called after each frame."""
    frames = []
    for scene in experiment.scenes_of_role("record"):
        for number, (moment, state) in enumerate(_states_of(experiment, body, scene)):
            frames.append((scene.name, number, moment, state))
            progress(1)
    if not frames:
        raise SoftprintError(
            f'{experiment.path}: no scene has role = "record", but states are sampled from such scenes'
        )
    names, numbers, times, rows = zip(*frames, strict=True)
    return Recording(np.array(rows), list(names), np.array(numbers, dtype=np.int64), np.array(times))


def _states_of(experiment: Experiment, body: ReducedBody, scene: SceneSpec) -> Iterator[tuple[float, Array]]:
    """Time [s] and handle rows of every frame."""
    model: SceneModel
    match experiment.sampling.record_with:
        case "full":
            model = full_space_model(experiment, body, scene, Path())
        case "condensed":
            model = condensed_model(experiment, body, scene)
        case _:
            model = bare_model(experiment, body, scene)
    for result in play(model, scene_steps(experiment, scene)):
        yield result.state.time, body.handles.rigid(model.rows(result.state))


def disturbed_states(
    body: ReducedBody, rows: Array, count: int, spread: float, rng: np.random.Generator
) -> Array:
    """(n * (1 + count), n_rows, dim): each of the states (n, n_rows, dim), followed by `count` copies of it with every
    handle moved at random. spread: standard deviation, in sizes of the body; frames turn by as much of a radian."""
    handles = body.handles
    unit = spread * body.mesh.size * handles.units(body.mesh.size)
    found = []
    for state in rows:
        found.append(state)
        found += [handles.retract(state, unit * rng.normal(size=handles.n_dofs)) for _ in range(count)]
    return np.array(found)


def spread_states(body: ReducedBody, rows: Array, count: int) -> IntArray:
    """Indices of ``count`` of the states ``rows`` (n, n_rows, dim) in farthest-point order, beginning with the one
    nearest to rest.

    Distance: Euclidean between normalised rigid-free descriptors, hence invariant to rigid motions. Fewer are returned
    if all others equal a chosen one.
    """
    with_rest = np.concatenate([body.rest_rows[None], rows])
    numbers = RigidFreeDescriptor.of(body).normalised(with_rest)
    rest, numbers = numbers[0], numbers[1:]
    first = int(np.argmin(np.linalg.norm(numbers - rest, axis=1)))
    return farthest_selection(lambda k: np.linalg.norm(numbers - numbers[k], axis=1), first, count)
