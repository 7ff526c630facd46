"""Free runs of the models: distance from full space over time, and timings."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from softprint.fem_truth.report.measurements.comparison import node_distances, root_mean_square
from softprint.runtime.arrays import Array, BoolArray, IntArray
from softprint.runtime.errors import SoftprintError
from softprint.runtime.scenes.motion_file import Motion
from softprint.runtime.scenes.speed import WARM

TOTAL = "total"  # the timing that includes all others, and the remainder


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


def free_running_row(
    motion: Motion, distances: Array, bare_rms: float | None, invalid: BoolArray
) -> dict[str, Any]:
    """A row of the table of free runs; bare_rms: RMS distance of the bare subspace [m], if it was simulated; invalid:
    (n_frames,), see `Motion.invalid`."""
    rms = root_mean_square(distances)
    return {
        "rms": rms,
        "relative": rms / bare_rms if bare_rms else None,
        "largest": float(distances.max()),
        "last": float(distances[-1]),
        "max_penetration": float(motion.penetration.max()),
        "not_converged": int(np.sum(~motion.converged)),
        "invalid": int(np.sum(invalid)),
    }


def timing_rows(motions: Mapping[str, Sequence[Motion]]) -> dict[str, dict[str, Any]]:
    """Time of a step in contact by model: mean, 95th percentile, median, and mean by phase; the share of these steps
    that converged, and ratios of means to the full space and to the bare subspace. The surface is not drawn.

    motions: model -> its motions in the test scenes. A model that never touches a collider has no row; in scenes
    without a collider all steps count.
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
        totals = _joined([motion.timings[TOTAL] for motion in recorded], touching)
        rows[name] = {
            "step": step,
            "p95": float(np.quantile(totals, 0.95)),
            "median": float(np.median(totals)),
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
    """(n_frames,) mask. Frame 0 is the start of the scene, which no step computed. The first ones are left out, at most
    half of them, because kernels may be compiled there."""
    touching = motion.in_contact.copy() if motion.colliders else np.ones(motion.n_frames, dtype=bool)
    touching[0] = False
    steps = np.flatnonzero(touching)
    touching[steps[: min(WARM, len(steps) // 2)]] = False
    return touching


def _mean_over(values: Sequence[Array | IntArray | BoolArray], masks: Sequence[BoolArray]) -> float:
    return float(np.mean(_joined(values, masks)))


def _joined(values: Sequence[Array | IntArray | BoolArray], masks: Sequence[BoolArray]) -> Array:
    """What the masks let through, of all motions in one array."""
    return np.concatenate([v[m] for v, m in zip(values, masks, strict=True)])
