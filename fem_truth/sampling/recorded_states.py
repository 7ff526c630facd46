"""States for contact samples: frames of recorded dynamics, spread by farthest point (thesis 5.3.2).

The scenes with ``role = "record"`` are run with the bare reduced model. States come from dynamics and not
from noise, because a random handle state can be at a saddle point, from which the lightest contact makes the body
snap.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from softprint.fem_truth.sampling.farthest import farthest_selection
from softprint.fem_truth.sampling.rigid_free import RigidFreeDescriptor
from softprint.runtime.arrays import Array, IntArray
from softprint.runtime.body.body import ReducedBody
from softprint.runtime.dynamics.state import ReducedState
from softprint.runtime.errors import SoftprintError
from softprint.runtime.scenes.playing import bare_model, play
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
    """Simulate every scene with ``role = "record"`` in the bare subspace; raises SoftprintError if there is none.
    progress(1) is called after each frame."""
    frames = []
    for scene in experiment.scenes_of_role("record"):
        for number, state in enumerate(_states_of(experiment, body, scene)):
            frames.append((scene.name, number, state.time, state.rows))
            progress(1)
    if not frames:
        raise SoftprintError(
            f'{experiment.path}: no scene has role = "record", but states are sampled from such scenes'
        )
    names, numbers, times, rows = zip(*frames, strict=True)
    return Recording(np.array(rows), list(names), np.array(numbers, dtype=np.int64), np.array(times))


def _states_of(experiment: Experiment, body: ReducedBody, scene: SceneSpec) -> Iterator[ReducedState]:
    model = bare_model(experiment, body, scene)
    return (result.state for result in play(model, scene_steps(experiment, scene)))


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
