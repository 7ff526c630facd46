"""Quality of the truth file: statuses, residuals, iterations, time, and the label-noise floor."""

from typing import Any

import numpy as np

from softprint.runtime.arrays import Array
from softprint.runtime.truth.truth_file import TruthData
from softprint.runtime.truth.truth_schema import CONVERGED, STATUS_NAMES


def truth_summary(truth: TruthData) -> dict[str, Any]:
    """The numbers of the section on samples. The noise floor is |u2 - u1| / |u1| of samples solved twice."""
    samples = truth.samples
    status, spread = samples["status"], truth.repeat["spread"]
    spread = spread[np.isfinite(spread)]
    counts = {name: int(np.sum(status == code)) for code, name in STATUS_NAMES.items()}
    # A contact's time includes second paths, so that the cost of a sample counts all work, also failed solves.
    seconds = float(truth.contacts["seconds"].sum() + truth.states["seconds"].sum())
    return {
        "samples": len(samples),
        "contacts": len(truth.contacts),
        "planned_contacts": truth.header.planned_contacts,
        "states": len(truth.states),
        "refused": len(truth.refused),
        "converged": counts[STATUS_NAMES[CONVERGED]],
        "usable": int(truth.usable.sum()),
        "statuses": {
            name: {"count": count, "share": count / max(1, len(samples))}
            for name, count in counts.items()
            if count
        },
        "flagged": int(samples["branch_flag"].sum()),
        "pierced": int(truth.pierced.sum()),
        "inverted": int(truth.inverted.sum()),
        "repeats": len(truth.repeat),
        "noise_floor": float(np.median(spread)) if len(spread) else None,
        "noise_90": float(np.quantile(spread, 0.9)) if len(spread) else None,
        "noise_worst": float(spread.max()) if len(spread) else None,
        "seconds": seconds,
        "seconds_per_sample": seconds / max(1, len(samples)),
    }


def quality_columns(truth: TruthData) -> dict[str, Array]:
    """Columns for the histograms, of converged samples: title -> values."""
    samples = truth.samples
    good = samples["status"] == CONVERGED
    return {
        "relative residual": samples["residual"][good],
        "relative Newton decrement": samples["decrement"][good],
        "Newton iterations": samples["newton_iterations"][good],
        "smallest det F": samples["min_det_F"][good],
        "remaining penetration [mm]": 1e3 * samples["max_depth"][good],
        "collider inside the body [mm]": 1e3 * samples["intrusion"][good],
        "core-seconds a sample": samples["seconds"][good],
    }
