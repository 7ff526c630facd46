"""How fast models play a scene: the measurement behind `softprint bench` and `benchmarks/bodies_speed.py`.

Every model plays the same scene in the same process with the same time step, to the same tolerance or with as many
Newton iterations at most; a model that is cut off before it has converged is not as fast as its figure says. A frame is
a step and the positions of the surface at its end, with all detail; on two cores the surface of a step is drawn
beside the next step, one frame late. Only frames with contact count: all of them where no limit is given, for contact
may grow harder as a scene goes on. The median is what another program on the machine does not spoil; mean and 95th
percentile tell of the slow frames that it hides. CPU seconds are of all threads of this process, and not of the one
that draws beside.
"""

from __future__ import annotations

import os
import platform
import time
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from statistics import median
from typing import TYPE_CHECKING, Any

import numpy as np

from runtime.dynamics.timings import PHASES
from runtime.scenes.background_drawing import BackgroundDrawing
from runtime.scenes.playing import ReducedModel, SceneModel

if TYPE_CHECKING:
    from runtime.experiment import Experiment


@dataclass(frozen=True)
class Speed:
    """steps: with contact; step, mean, slow: median, mean and 95th percentile of a frame's wall time [s]; cpu: median
    CPU time [s]; iterations: mean of Newton; converged: share of the steps; phases: median seconds by phase, empty
    for models that do not tell."""

    model: str
    steps: int
    step: float
    mean: float
    slow: float
    cpu: float
    iterations: float
    converged: float
    phases: Mapping[str, float]

    @property
    def frames_per_second(self) -> float:
        return 1.0 / self.step


def with_newton(experiment: Experiment, iterations: int | None, tolerance: float | None = None) -> Experiment:
    """The experiment with so many Newton iterations a step at most, to this tolerance; None: as it says."""
    asked = {"max_iterations": iterations, "tolerance": tolerance}
    dynamics = experiment.dynamics.model_copy(
        update={name: value for name, value in asked.items() if value is not None}
    )
    return experiment.model_copy(update={"dynamics": dynamics})


def measure(
    name: str, model: SceneModel, n_steps: int, at_most: int | None, beside: bool = False
) -> Speed | None:
    """Play up to n_steps, until ``at_most`` steps with contact are timed (None: all of them); None if there are none.
    beside: draw the surface of a step beside the next one, if the model is a reduced one."""
    if beside and isinstance(model, ReducedModel):
        with BackgroundDrawing(model) as drawer:
            found = _measure(name, model, n_steps, at_most, drawer.next)
            drawer.last()
            return found
    return _measure(name, model, n_steps, at_most, model.surface_positions)


def _warm_up(model: SceneModel, n_steps: int, draw: Callable[[Any], object]) -> None:
    """Play to the first contact and no further: what is compiled or loaded there takes seconds, once on a machine or in
    a process, and is no part of a frame."""
    state = model.start().state
    for _ in range(n_steps):
        result = model.step(state)
        state = result.state
        draw(state)
        if result.penetration > 0:
            break


def _measure(
    name: str, model: SceneModel, n_steps: int, at_most: int | None, draw: Callable[[Any], object]
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
        if result.penetration <= 0:
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
    by_phase = {phase: median(seconds) for phase, seconds in phases.items()}
    return Speed(
        name,
        len(walls),
        median(walls),
        float(np.mean(walls)),
        float(np.quantile(walls, 0.95)),
        median(cpus),
        float(np.mean(iterations)),
        float(np.mean(converged)),
        by_phase,
    )


def speed_table(speeds: list[Speed]) -> list[str]:
    """One line a model: milliseconds (median, mean, 95th percentile), frames a second by the median, Newton iterations,
    share of converged steps, ratios of medians to the bare subspace and to full space, phases."""
    by_name = {speed.model: speed for speed in speeds}
    heads = ("steps", "ms/step", "mean", "95 %", "CPU ms", "1/s", "Newton", "conv.", "of bare", "full is")
    lines = [f"{'model':<14}" + "".join(f"{head:>9}" for head in heads) + "  phases [ms]"]
    for speed in speeds:
        ratios = [
            f"{speed.step / by_name['bare'].step:.2f}x" if "bare" in by_name else "",
            f"{by_name['full'].step / speed.step:.1f}x" if "full" in by_name else "",
        ]
        phases = ", ".join(f"{phase} {1e3 * seconds:.2f}" for phase, seconds in speed.phases.items())
        lines.append(
            f"{speed.model:<14}{speed.steps:>9}{1e3 * speed.step:>9.2f}{1e3 * speed.mean:>9.2f}"
            f"{1e3 * speed.slow:>9.2f}{1e3 * speed.cpu:>9.2f}{speed.frames_per_second:>9.1f}"
            f"{speed.iterations:>9.1f}{speed.converged:>9.0%}{ratios[0]:>9}{ratios[1]:>9}  {phases}"
        )
    return lines


def machine() -> dict[str, Any]:
    """Processor, cores and threads, for beside the figures."""
    name = platform.processor() or platform.machine()
    if os.path.exists("/proc/cpuinfo"):
        with open("/proc/cpuinfo", encoding="utf-8") as lines:
            models = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
        name = models[0] if models else name
    threads = {
        key: os.environ[key] for key in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS") if key in os.environ
    }
    return {"processor": name, "cores": os.cpu_count(), "threads": threads, "system": platform.platform()}


def speeds_as_json(speeds: list[Speed]) -> list[dict[str, Any]]:
    """Plain values, in seconds."""
    return [asdict(speed) | {"frames_per_second": speed.frames_per_second} for speed in speeds]
