"""What a reader has to know about the scenes of a report before its figures."""

from __future__ import annotations

from softprint.fem_truth.report.measurements.comparison import error_row
from softprint.fem_truth.report.measurements.held_out import SceneComparison

# A static solution that leaves more of the bare error than this is worth a sentence.
_STATIC = 0.1


def scene_note(name: str, comparison: SceneComparison | None, n_left_out: int) -> str:
    """Of a scene without anything to compare, and of one that no static model can follow; empty for others. n_left_out:
    frames in contact in which the full-space motion is invalid."""
    if comparison is None:
        return _without_contact(name, n_left_out)
    return _not_static(name, comparison)


def _without_contact(name: str, n_left_out: int) -> str:
    why = (
        "the full-space body is pierced, or has inverted cells, in every frame in contact"
        if n_left_out
        else "the body never touches the collider"
    )
    return f"In the scene \u201c{name}\u201d {why}, so there is no error to report: change its keyframes."


def _not_static(name: str, comparison: SceneComparison) -> str:
    """A correction is a static solution of what the subspace lacks: it cannot be better than the exact one."""
    statics = comparison.solved.get("statics")
    if statics is None or not statics.frames.size:
        return ""
    left = error_row(statics).relative_rms
    if left <= _STATIC:
        return ""
    return (
        f"In the scene \u201c{name}\u201d full statics, the exact static solution at the states of full space, "
        f"leaves {left:.0%} of the bare error, and so does every correction, however good: look for fast motion, "
        "friction, or rigid frames that are soft in full space."
    )
