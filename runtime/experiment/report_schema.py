"""The `[report]` table: how thoroughly the held-out motions are judged."""

from __future__ import annotations

from pydantic import Field

from runtime.experiment.section import Count, Name, Section


class ReportSpec(Section):
    """`[report]`: what `softprint report` solves and puts first."""

    frames: Count = Field(24, description="frames of a test scene on which the full-space solvers run")
    model: Name = Field("ours", description="the correction that headline figures speak of")
