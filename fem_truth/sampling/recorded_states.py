"""States worth solving contacts at: frames of recorded dynamics, spread by farthest point (thesis 5.3.2).

The scenes with ``role = "record"`` are run with the bare reduced model. States come from dynamics and not from noise,
because a random handle state can sit at a saddle, from which the lightest touch makes the body snap (DESIGN.md, part 6).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from fem_truth.sampling.farthest import farthest_selection
from fem_truth.sampling.rigid_free import RigidFreeDescriptor
from runtime.arrays import Array, IntArray
from runtime.body.body import ReducedBody
from runtime.errors import SoftprintError

if TYPE_CHECKING:
    from runtime.experiment import Experiment


@dataclass(frozen=True, eq=False)
class Recording:
    """All frames of all recorded scenes.

    rows: (n, n_rows, dim); scene: n names; frame: (n,) number within its scene; time: (n,) [s].
    """

    rows: Array
    scene: list[str]
    frame: IntArray
    time: Array


def record_scenes(experiment: Experiment, body: ReducedBody) -> Recording:
    """Run every scene with ``role = "record"``; raises SoftprintError if there is none."""
    frames = [
        (scene.name, number, time, rows)
        for scene in experiment.scenes
        if scene.role == "record"
        for number, (time, rows) in enumerate(_run(experiment, body, scene.name))
    ]
    if not frames:
        raise SoftprintError('no scene has role = "record": the states to sample come from such scenes; add one')
    scene, number, time, rows = zip(*frames, strict=True)
    return Recording(np.array(rows), list(scene), np.array(number, dtype=np.int64), np.array(time))


def _run(experiment: Experiment, body: ReducedBody, scene: str) -> Iterator[tuple[float, Array]]:
    raise NotImplementedError


def spread_states(body: ReducedBody, rows: Array, count: int) -> IntArray:
    """Indices of ``count`` of the states ``rows`` (n, n_rows, dim) in farthest-point order, the rest-most one first.

    Distance: Euclidean between normalised rigid-free descriptors, so that a rigid motion of states changes nothing.
    Fewer are returned where the others all equal a chosen one.
    """
    with_rest = np.concatenate([body.rest_rows[None], rows])
    numbers = RigidFreeDescriptor.of(body).normalised(with_rest)
    rest, numbers = numbers[0], numbers[1:]
    first = int(np.argmin(np.linalg.norm(numbers - rest, axis=1)))
    return farthest_selection(lambda k: np.linalg.norm(numbers - numbers[k], axis=1), first, count)
