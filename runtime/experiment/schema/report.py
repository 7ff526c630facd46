"""The `[report]` table: the evaluation of held-out motions."""

from __future__ import annotations

from pydantic import Field

from softprint.runtime.experiment.schema.section import Count, Name, Section


class ReportSpec(Section):
    """`[report]`: settings of `softprint report`."""

    frames: Count = Field(24, description="frames of a test scene that the full-space solvers solve")
    model: Name = Field("ours", description="the correction of the headline figures")
