"""What a reader has to know about the scenes of a report before its figures."""

from __future__ import annotations

from collections.abc import Sequence

from softprint.fem_truth.report.assemble import JudgedScene
from softprint.fem_truth.report.measurements.comparison import error_row

# A static solution that leaves more of the bare error than this is worth a sentence.
_STATIC = 0.1


def scene_notes(scenes: Sequence[JudgedScene]) -> list[str]:
    """Of scenes without anything to compare, and of those that no static model can follow."""
    return [note for scene in scenes if (note := _without_contact(scene) or _not_static(scene))]


def _without_contact(scene: JudgedScene) -> str:
    if scene.comparison is not None:
        return ""
    why = (
        "the full-space body is pierced, or has inverted cells, in every frame in contact"
        if scene.n_left_out
        else "the body never touches the collider"
    )
    return f"In the scene \u201c{scene.name}\u201d {why}, so there is no error to report: change its keyframes."


def _not_static(scene: JudgedScene) -> str:
    """A correction is a static solution of what the subspace lacks: it cannot be better than the exact one."""
    assert scene.comparison is not None
    statics = scene.comparison.solved.get("statics")
    if statics is None or not statics.frames.size:
        return ""
    left = error_row(statics).relative_rms
    if left <= _STATIC:
        return ""
    return (
        f"In the scene \u201c{scene.name}\u201d full statics, the exact static solution at the states of full space, "
        f"leaves {left:.0%} of the bare error, and so does every correction, however good: look for fast motion, "
        "friction, or rigid frames that are soft in full space."
    )
