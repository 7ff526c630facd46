"""The frames that a report shows: their choice, the models shown side by side, and their pictures."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from softprint.fem_truth.report.drawing.picture import Picture, Renderer
from softprint.fem_truth.report.drawing.style import ModelStyle
from softprint.fem_truth.report.measurements.body_alone import NoCollider
from softprint.fem_truth.report.measurements.comparison import frames_to_show, node_distances
from softprint.fem_truth.report.measurements.held_out import Comparer, SceneComparison
from softprint.fem_truth.report.page import ShownFrame
from softprint.runtime.arrays import Array


def shown_models(comparison: SceneComparison, model: str | None) -> list[str]:
    """Full space, bare subspace, the thesis's networks and the model the report is about, as far as they exist."""
    wanted = ["full", "bare", "thesis4", "thesis5", model]
    return [name for name in wanted if name is not None and name in comparison.everywhere]


def showcase(
    comparer: Comparer,
    comparison: SceneComparison,
    renderer: Renderer,
    models: Sequence[str],
    styles: dict[str, ModelStyle],
) -> tuple[list[ShownFrame], list[dict[str, Any]]]:
    """Pictures of the chosen frames, and their numbers for the JSON."""
    judged = comparison.everywhere[models[-1]]
    alone = isinstance(comparer.collider, NoCollider)
    chosen = frames_to_show(comparison.contact, comparison.depth, judged, alone)
    bare = comparison.everywhere["bare"]
    limit = max(
        float(bare.worst_node[bare.frames == frame][0]) for frame, _ in chosen
    )  # one colour bar for all
    frames: list[ShownFrame] = []
    numbers: list[dict[str, Any]] = []
    for index, (frame, why) in enumerate(chosen):
        comparer.lead_to(frame, comparison.contact)
        frames.append(_pictures(comparer, renderer, index, frame, why, models, styles, limit))
        at = comparison.contact == frame
        numbers.append(
            {
                "frame": frame,
                "time": float(comparer.motion.times[frame]),
                "why": why,
                "depth": float(comparison.depth[at][0]),
                "heat_limit": limit,
                "relative": {name: float(comparison.everywhere[name].relative[at][0]) for name in models[1:]},
            }
        )
    return frames, numbers


def _pictures(
    comparer: Comparer,
    renderer: Renderer,
    index: int,
    frame: int,
    why: str,
    models: Sequence[str],
    styles: dict[str, ModelStyle],
    limit: float,
) -> ShownFrame:
    pose = comparer.motion.poses[frame]
    positions = comparer.positions(frame)
    full = positions["full"]
    alone = isinstance(comparer.collider, NoCollider)
    centre = None if alone else _deepest_point(comparer, full, frame)
    outside: list[Picture | None] = []
    cut: list[Picture | None] = []
    heat: list[Picture | None] = []
    for name in models:
        label, x = styles[name].label, positions[name]
        shown = "the body" if alone else "the body and the collider"
        outside.append(renderer.outside(x, pose, f"{label}, frame {frame}: {shown}"))
        cut.append(
            None
            if centre is None
            else renderer.cut(
                x, pose, centre, f"{label}, frame {frame}: the contact under the collider, cut open"
            )
        )
        if name == "full":
            heat.append(None)  # its place is taken by the colour bar
        else:
            alt = f"{label}, frame {frame}: the body coloured by its distance from the full-space body"
            heat.append(renderer.heat(x, node_distances(x, full), limit, alt))
    return ShownFrame(
        index=index,
        why=why,
        frame=frame,
        models=models,
        outside=outside,
        cut=cut,
        heat=heat,
    )


def _deepest_point(comparer: Comparer, positions: Array, frame: int) -> Array:
    """(dim,) the surface node that is deepest in the collider."""
    surface = comparer.body.mesh.surface_nodes
    depth = comparer.depth(positions, comparer.motion.poses[frame])
    return positions[surface[int(np.argmax(depth))]]
