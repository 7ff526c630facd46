"""How fast models play a scene: the measurement of `softprint bench` and `benchmarks/bodies_speed.py`.

Every model plays the same scene in the same process with the same time step, to the same tolerance or with as many
Newton iterations at most; a model that is cut off before it has converged is not as fast as its figure says. A frame is
a step and the positions of the surface at its end, with all detail; on two cores the surface of a step is drawn
beside the next step, one frame late. Only frames with contact count: all of them where no limit is given, for contact
may grow harder as a scene goes on. Speed is the mean frame and the 95th percentile, which count the slow
frames; the median stands beside them, because other programs on the machine disturb it least. CPU seconds are of all
threads of this process, and not of the one that draws beside.
"""

from __future__ import annotations

import os
import platform
import time
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from softprint.runtime.dynamics.timings import PHASES
from softprint.runtime.linalg.one_thread import blas_threads
from softprint.runtime.scenes.background_drawing import BackgroundDrawing
from softprint.runtime.scenes.playing import ReducedModel, SceneModel

if TYPE_CHECKING:
    from softprint.runtime.experiment import Experiment

# Frames in contact before the first that is timed. The first have no contact of the step before to start from, so that
# some kernels run in later ones only.
WARM = 5


@dataclass(frozen=True)
class Speed:
    """steps: with contact; mean, p95, median: of a frame's wall time [s], p95 the 95th percentile; cpu: mean CPU time
    [s]; iterations: mean of Newton; converged: share of the steps; phases: mean seconds by phase, empty for models
    that do not tell."""

    model: str
    steps: int
    mean: float
    p95: float
    median: float
    cpu: float
    iterations: float
    converged: float
    phases: Mapping[str, float]

    @property
    def frames_per_second(self) -> float:
        """Of the mean frame."""
        return 1.0 / self.mean


def with_newton(experiment: Experiment, iterations: int | None, tolerance: float | None = None) -> Experiment:
    """The experiment with another limit of Newton iterations for a step and another tolerance; None: unchanged."""
    limits = {"max_iterations": iterations, "tolerance": tolerance}
    dynamics = experiment.dynamics.model_copy(
        update={name: value for name, value in limits.items() if value is not None}
    )
    return experiment.model_copy(update={"dynamics": dynamics})


def measure(
    name: str,
    model: SceneModel,
    n_steps: int,
    at_most: int | None,
    beside: bool = False,
    progress: Callable[[int], None] = lambda n: None,
) -> Speed | None:
    """Play up to n_steps, until ``at_most`` steps with contact are timed (None: all of them); None if there are none.
    beside: draw the surface of a step in the background of the next one, if the model is reduced; progress(1) is called
    between frames."""
    if beside and isinstance(model, ReducedModel):
        with BackgroundDrawing(model) as drawer:
            found = _measure(name, model, n_steps, at_most, drawer.next, progress)
            drawer.last()
            return found
    return _measure(name, model, n_steps, at_most, model.surface_positions, progress)


def _warm_up(model: SceneModel, n_steps: int, draw: Callable[[Any], object]) -> None:
    """Play a few frames in contact and no further: compiling and loading take seconds once, and are not part of a
    frame."""
    state, in_contact = model.start().state, 0
    for _ in range(n_steps):
        result = model.step(state)
        state = result.state
        draw(state)
        in_contact += result.in_contact
        if in_contact == WARM:
            break


def _measure(
    name: str,
    model: SceneModel,
    n_steps: int,
    at_most: int | None,
    draw: Callable[[Any], object],
    progress: Callable[[int], None],
) -> Speed | None:
    _warm_up(model, n_steps, draw)
    state = model.start().state
    walls: list[float] = []
    cpus: list[float] = []
    iterations: list[int] = []
    converged: list[bool] = []
    phases: dict[str, list[float]] = {}
    for _ in range(n_steps):
        began, cpu_began = time.perf_counter(), time.process_time()
        result = model.step(state)
        stepped = time.perf_counter()
        draw(result.state)
        detail = time.perf_counter() - stepped
        wall, cpu = time.perf_counter() - began, time.process_time() - cpu_began
        state = result.state
        progress(1)
        if not result.in_contact:
            continue
        walls.append(wall)
        cpus.append(cpu)
        iterations.append(result.iterations)
        converged.append(result.converged)
        for phase in PHASES:
            if phase in result.timings:
                phases.setdefault(phase, []).append(result.timings[phase])
        phases.setdefault("surface", []).append(detail)
        if len(walls) == at_most:
            break
    if not walls:
        return None
    by_phase = {phase: float(np.mean(seconds)) for phase, seconds in phases.items()}
    return Speed(
        name,
        len(walls),
        float(np.mean(walls)),
        float(np.quantile(walls, 0.95)),
        float(np.median(walls)),
        float(np.mean(cpus)),
        float(np.mean(iterations)),
        float(np.mean(converged)),
        by_phase,
    )


def speed_table(speeds: list[Speed]) -> list[str]:
    """One line a model: milliseconds (mean, 95th percentile, median), frames a second by the mean, Newton iterations,
    share of converged steps, ratios of means to the bare subspace and to full space, phases."""
    by_name = {speed.model: speed for speed in speeds}
    heads = ("steps", "mean ms", "95 %", "median", "CPU ms", "1/s", "Newton", "conv.", "of bare", "full is")
    width = max([14, *(len(speed.model) for speed in speeds)])
    lines = [f"{'model':<{width}}" + "".join(f"{head:>9}" for head in heads) + "  phases [ms]"]
    for speed in speeds:
        ratios = [
            f"{speed.mean / by_name['bare'].mean:.2f}x" if "bare" in by_name else "",
            f"{by_name['full'].mean / speed.mean:.1f}x" if "full" in by_name else "",
        ]
        phases = ", ".join(f"{phase} {1e3 * seconds:.2f}" for phase, seconds in speed.phases.items())
        lines.append(
            f"{speed.model:<{width}}{speed.steps:>9}{1e3 * speed.mean:>9.2f}{1e3 * speed.p95:>9.2f}"
            f"{1e3 * speed.median:>9.2f}{1e3 * speed.cpu:>9.2f}{speed.frames_per_second:>9.1f}"
            f"{speed.iterations:>9.1f}{speed.converged:>9.0%}{ratios[0]:>9}{ratios[1]:>9}  {phases}"
        )
    return lines


def machine() -> dict[str, Any]:
    """Processor, cores and threads, to report with the timings."""
    name = platform.processor() or platform.machine()
    if os.path.exists("/proc/cpuinfo"):
        with open("/proc/cpuinfo", encoding="utf-8") as lines:
            models = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
        name = models[0] if models else name
    return {
        "processor": name,
        "cores": os.cpu_count(),
        "threads": blas_threads(),
        "system": platform.platform(),
    }


def speeds_as_json(speeds: list[Speed]) -> list[dict[str, Any]]:
    """Plain values, in seconds."""
    return [asdict(speed) | {"frames_per_second": speed.frames_per_second} for speed in speeds]
