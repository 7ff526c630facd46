"""What models did when they ran on their own: distance from the full space over time, and the time it
took."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from fem_truth.report.comparison import node_distances, root_mean_square
from runtime.arrays import Array, BoolArray, IntArray
from runtime.errors import SoftprintError
from runtime.scenes.motion_file import Motion

TOTAL = "total"  # the timing that holds all the others, and what no phase claims


def distances_over_time(motion: Motion, full: Motion) -> Array:
    """(n_frames,) RMS distance of the nodes between two motions of the same scene [m]."""
    if motion.n_frames != full.n_frames or not np.allclose(motion.times, full.times, rtol=0, atol=1e-9):
        raise SoftprintError(
            f"the motion {motion.path} has {motion.n_frames} frames until {motion.times[-1]:.3f} s, "
            f"but the full-space motion has {full.n_frames} until {full.times[-1]:.3f} s: "
            "simulate the scene again with both"
        )
    return np.array(
        [
            root_mean_square(node_distances(motion.positions(f), full.positions(f)))
            for f in range(full.n_frames)
        ]
    )


def free_running_row(motion: Motion, distances: Array, bare_rms: float | None) -> dict[str, Any]:
    """A line of the table of free runs; bare_rms: RMS distance of the bare subspace [m], where it was
    simulated."""
    rms = root_mean_square(distances)
    return {
        "rms": rms,
        "relative": rms / bare_rms if bare_rms else None,
        "largest": float(distances.max()),
        "last": float(distances[-1]),
        "max_penetration": float(motion.penetration.max()),
        "not_converged": int(np.sum(~motion.converged)),
    }


def timing_rows(motions: Mapping[str, Sequence[Motion]]) -> dict[str, dict[str, Any]]:
    """Mean time of a step in contact by model, by phase, the share of these steps that converged, and the ratios to the
    full space and to the bare subspace. Nobody drew the surface in this time.

    motions: model -> its motions in the test scenes. A model that never touches a collider has no line.
    """
    rows: dict[str, dict[str, Any]] = {}
    for name, recorded in motions.items():
        touching = [_steps_in_contact(motion) for motion in recorded]
        if not any(mask.any() for mask in touching):
            continue
        phases = {
            phase: _mean_over([motion.timings[phase] for motion in recorded], touching)
            for phase in recorded[0].timings
        }
        step = phases.pop(TOTAL)
        rows[name] = {
            "step": step,
            "steps_per_second": 1.0 / step,
            "steps": int(sum(mask.sum() for mask in touching)),
            "iterations": _mean_over([motion.iterations for motion in recorded], touching),
            "converged": _mean_over([motion.converged for motion in recorded], touching),
            "phases": {**phases, "other": max(0.0, step - sum(phases.values()))},
        }
    for row in rows.values():
        row["faster_than_full"] = rows["full"]["step"] / row["step"] if "full" in rows else None
        row["cost_of_bare"] = row["step"] / rows["bare"]["step"] if "bare" in rows else None
    return rows


def _steps_in_contact(motion: Motion) -> BoolArray:
    """(n_frames,); frame 0 is where the scene starts, and no step led there. Without the first of several: there, once
    on a machine, kernels are compiled."""
    touching = np.asarray(motion.penetration > 0)
    touching[0] = False
    if np.count_nonzero(touching) > 1:
        touching[np.argmax(touching)] = False
    return touching


def _mean_over(values: Sequence[Array | IntArray | BoolArray], masks: Sequence[BoolArray]) -> float:
    return float(np.mean(np.concatenate([v[m] for v, m in zip(values, masks, strict=True)])))
