"""Assembles a report: combines the evaluated scenes, the truth file and the training results into a summary and a
page."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from softprint.fem_truth.report.drawing import figures
from softprint.fem_truth.report.drawing.picture import Picture, Renderer
from softprint.fem_truth.report.drawing.style import ModelStyle, styles_for
from softprint.fem_truth.report.headline import headline_cards
from softprint.fem_truth.report.machine import machine_summary
from softprint.fem_truth.report.measurements.body_alone import NoCollider
from softprint.fem_truth.report.measurements.comparison import (
    ModelFrames,
    error_table,
    pool,
    relative_displacement_error,
)
from softprint.fem_truth.report.measurements.held_out import Comparer, SceneComparison
from softprint.fem_truth.report.measurements.learning import Learning
from softprint.fem_truth.report.measurements.motions import distances_over_time, free_running_row, timing_rows
from softprint.fem_truth.report.measurements.truth_quality import quality_columns, truth_summary
from softprint.fem_truth.report.page import PageContent, ScenePictures
from softprint.fem_truth.report.report_json import (
    REPORT_VERSION,
    body_summary,
    collider_summary,
    experiment_summary,
    file_summaries,
    plain,
)
from softprint.fem_truth.report.shapes import ShapeSection
from softprint.fem_truth.report.showcase import showcase, shown_models
from softprint.runtime.arrays import Array
from softprint.runtime.body.body import ReducedBody
from softprint.runtime.contact.intrusion import pierced_from
from softprint.runtime.experiment import Experiment
from softprint.runtime.io.files import provenance
from softprint.runtime.scenes.motion_file import Motion
from softprint.runtime.truth.truth_file import TruthData

# Why a frame is the large picture, see `frames_to_show`.
_FIRST = ("deepest contact", "farthest from the bare subspace")


@dataclass(frozen=True, eq=False)
class JudgedScene:
    """A test scene with its results. motions: the free runs by model, including `full`; comparison: None if there is no
    frame to compare; n_left_out: frames in contact in which the full-space motion is invalid."""

    name: str
    comparer: Comparer
    comparison: SceneComparison | None
    motions: Mapping[str, Motion]
    n_left_out: int


@dataclass(frozen=True, eq=False)
class ReportInputs:
    """All inputs of a report."""

    experiment: Experiment
    body: ReducedBody
    scenes: Sequence[JudgedScene]
    truth: TruthData | None
    learning: Learning
    model: str | None
    folder: Path
    files: Sequence[Path]
    notes: Sequence[str]
    shapes: ShapeSection | None = None


def assemble(inputs: ReportInputs, make_renderer: Callable[[JudgedScene], Renderer] | None) -> PageContent:
    """The page's content, including its summary; make_renderer: None for a page without renderings."""
    styles = styles_for(_models(inputs))
    judged = [scene for scene in inputs.scenes if scene.comparison is not None]
    summary = _what_was_run(inputs)
    summary |= _pooled([scene.comparison for scene in judged if scene.comparison is not None])
    summary["timings"] = timing_rows(_by_model(inputs.scenes))
    summary["phases"] = _phases(summary["timings"])
    summary["truth"] = truth_summary(inputs.truth) if inputs.truth is not None else None
    summary |= inputs.learning.summary()
    shapes = inputs.shapes
    summary["shapes"] = None if shapes is None else shapes.summary

    pictures: dict[str, ScenePictures] = {}
    summary["scenes"] = []
    for number, scene in enumerate(inputs.scenes):
        scene_summary, shown = _scene(scene, number, inputs.model, styles, make_renderer)
        summary["scenes"].append(scene_summary)
        pictures[scene.name] = shown

    summary["headline"] = {
        "model": inputs.model,
        "cards": [asdict(card) for card in headline_cards(plain(summary), inputs.model, styles)],
        "hero_caption": "",
    }
    hero, summary["headline"]["hero_caption"] = _hero(summary, pictures)
    return PageContent(
        plain(summary),
        pictures,
        _plots(inputs, summary, styles),
        styles,
        hero,
        shapes.views if shapes else (),
    )


def _models(inputs: ReportInputs) -> list[str]:
    names = ["full", "bare", *inputs.learning.headers]
    for scene in inputs.scenes:
        names += [*scene.motions, *(scene.comparison.solved if scene.comparison else ())]
    return names


def _what_was_run(inputs: ReportInputs) -> dict[str, Any]:
    collider = inputs.scenes[0].comparer.collider
    return {
        "softprint_report": REPORT_VERSION,
        "made": datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC"),
        "experiment": experiment_summary(inputs.experiment),
        "body": body_summary(inputs.body),
        "collider": None
        if isinstance(collider, NoCollider)
        else collider_summary(inputs.experiment, collider),
        "machine": machine_summary(),
        "versions": provenance(),
        "files": file_summaries(inputs.folder, inputs.files),
        "notes": list(inputs.notes),
    }


def _pooled(comparisons: Sequence[SceneComparison]) -> dict[str, Any]:
    """The errors over all test scenes together."""
    return {
        "errors": error_table(_pool_models([c.everywhere for c in comparisons])),
        "errors_solved": error_table(_pool_models([c.solved for c in comparisons])),
        "contact_displacement": _displacement_errors(comparisons),
    }


def _pool_models(scenes: Sequence[Mapping[str, ModelFrames]]) -> dict[str, ModelFrames]:
    scenes = [scene for scene in scenes if scene]
    shared = [name for name in scenes[0] if all(name in scene for scene in scenes)] if scenes else []
    return {name: pool([scene[name] for scene in scenes]) for name in shared}


def _displacement_errors(comparisons: Sequence[SceneComparison]) -> dict[str, float]:
    solved = [comparison for comparison in comparisons if len(comparison.exact)]
    if not solved:
        return {}
    exact = np.concatenate([comparison.exact for comparison in solved])
    return {
        name: relative_displacement_error(np.concatenate([c.missed[name] for c in solved]), exact)
        for name in solved[0].missed
        if all(name in comparison.missed for comparison in solved)
    }


def _by_model(scenes: Sequence[JudgedScene]) -> dict[str, list[Motion]]:
    result: dict[str, list[Motion]] = {}
    for scene in scenes:
        for name, motion in scene.motions.items():
            result.setdefault(name, []).append(motion)
    return result


def _phases(timings: Mapping[str, Any]) -> list[str]:
    return list(dict.fromkeys(phase for row in timings.values() for phase in row["phases"]))


def _scene(
    scene: JudgedScene,
    number: int,
    model: str | None,
    styles: dict[str, ModelStyle],
    make_renderer: Callable[[JudgedScene], Renderer] | None,
) -> tuple[dict[str, Any], ScenePictures]:
    times = [float(time) for time in scene.comparer.motion.times]
    free, free_curves = _free_running(scene)
    summary: dict[str, Any] = {"name": scene.name, "n_frames": len(times), "time": times, "free": free}
    summary["free_over_time"] = free_curves
    summary["n_left_out"] = scene.n_left_out
    plots = {}
    if len(free_curves):
        millimetres = {name: 1e3 * curve for name, curve in free_curves.items()}
        plots["free"] = figures.over_time(f"free{number}", times, millimetres, styles, "RMS distance [mm]")
    comparison = scene.comparison
    if comparison is None:
        return {**summary, "n_contact": 0, "errors_all": {}, "errors_solved": {}, "shown": []}, ScenePictures(
            plots
        )

    summary |= _errors(comparison)
    curves = {
        name: _spread(frames, len(times)) for name, frames in comparison.everywhere.items() if name != "full"
    }
    marks = {
        name: ([times[f] for f in frames.frames], list(1e3 * frames.rms))
        for name, frames in comparison.solved.items()
        if name not in comparison.everywhere
    }
    depth = np.zeros(len(times))
    depth[comparison.contact] = comparison.depth
    plots["error"] = figures.over_time(
        f"error{number}",
        times,
        {name: 1e3 * curve for name, curve in curves.items()},
        styles,
        "RMS distance [mm]",
        depth=None if isinstance(scene.comparer.collider, NoCollider) else 1e3 * depth,
        marks=marks,
    )
    summary["plotted"] = [name for name in styles if name in curves or name in marks]
    if make_renderer is None:
        return {**summary, "shown": []}, ScenePictures(plots)
    renderer = make_renderer(scene)
    models = shown_models(comparison, model)
    frames, summary["shown"] = showcase(scene.comparer, comparison, renderer, models, styles)
    return summary, ScenePictures(plots, frames, renderer.description)


def _errors(comparison: SceneComparison) -> dict[str, Any]:
    solved = next(iter(comparison.solved.values()), None)
    return {
        "n_contact": len(comparison.contact),
        "n_solved": 0 if solved is None else len(solved.frames),
        "contact_frames": comparison.contact,
        "press_depth": comparison.depth,
        "errors_all": error_table(comparison.everywhere),
        "errors_solved": error_table(comparison.solved),
        "contact_displacement": _displacement_errors([comparison]),
        "over_time": {name: frames.rms for name, frames in comparison.everywhere.items()},
        "solved_frames": [] if solved is None else solved.frames,
        "solved_over_time": {name: frames.rms for name, frames in comparison.solved.items()},
        "unsolved": [{"frame": frame, "reason": reason} for frame, reason in comparison.unsolved],
        "solve_seconds": comparison.solve_seconds,
    }


def _spread(frames: ModelFrames, n_frames: int) -> Array:
    """RMS over all frames of the motion, NaN in frames without contact."""
    values = np.full(n_frames, np.nan)
    values[frames.frames] = frames.rms
    return values


def _free_running(scene: JudgedScene) -> tuple[dict[str, Any], dict[str, Array]]:
    full = scene.motions["full"]
    curves = {
        name: distances_over_time(motion, full) for name, motion in scene.motions.items() if name != "full"
    }
    bare_rms = float(np.sqrt(np.mean(curves["bare"] ** 2))) if "bare" in curves else None
    limit = pierced_from(scene.comparer.body.mesh)
    return {
        name: free_running_row(scene.motions[name], curve, bare_rms, scene.motions[name].invalid(limit))
        for name, curve in curves.items()
    }, curves


def _hero(
    summary: dict[str, Any], pictures: Mapping[str, ScenePictures]
) -> tuple[list[tuple[str, Picture]], str]:
    """The large picture: the cut (or the whole body, without a cut) in the frame of deepest contact."""
    for scene in summary["scenes"]:
        for frame, numbers in zip(pictures[scene["name"]].frames, scene["shown"], strict=True):
            first = next((why for why in _FIRST if why in numbers["why"]), None)
            if first is None:
                continue
            opened = all(picture is not None for picture in frame.cut)
            views = frame.cut if opened else frame.outside
            caption = (
                f"{first.capitalize()} in the held-out motion \u201c{scene['name']}\u201d: "
                f"frame {numbers['frame']}, {numbers['time']:.2f} s. "
                "Every model is given the same reduced state"
                + ("; the body is cut open through the contact." if opened else ".")
            )
            return [(name, view) for name, view in zip(frame.models, views, strict=True) if view], caption
    return [], ""


def _plots(
    inputs: ReportInputs, summary: Mapping[str, Any], styles: Mapping[str, ModelStyle]
) -> dict[str, str]:
    plots = {}
    if summary["timings"]:
        milliseconds = {
            name: {phase: 1e3 * seconds for phase, seconds in row["phases"].items()}
            for name, row in summary["timings"].items()
        }
        plots["phases"] = figures.phases("phases", milliseconds, styles)
    if inputs.learning.histories:
        plots["loss"] = figures.loss_curves("loss", inputs.learning.histories, styles)
    if inputs.truth is not None and len(inputs.truth.samples):
        plots["quality"] = figures.histograms("quality", quality_columns(inputs.truth))
    if inputs.shapes is not None:
        shapes = inputs.shapes.summary
        errors = {
            model: {shape: row["rms"] for shape, row in rows.items()}
            for model, rows in shapes["shapes"].items()
        }
        order = sorted(shapes["testing"], key=lambda shape: -errors[shapes["judged"]][shape])
        plots["shapes"] = figures.by_shape("shapes", errors, order, styles)
    return plots
