"""How far a played scene is from the reference: rows of the table, their file, and the plot."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from benchmarks.peers.engine import Played, Setting
from benchmarks.peers.scene import Scene
from softprint.fem_truth.report.drawing.style import styles_for
from softprint.runtime.arrays import Array
from softprint.runtime.io.files import atomic_path

# Of engines that are not models of this project: colours of Okabe and Ito, which the models do not use.
_COLOURS = {"MuJoCo flex": "#009e73", "MuJoCo flex, cells": "#a6761d", "Newton VBD": "#56b4e9"}
_STYLES = {"full space": "full", "bare": "bare", "mechanics": "mechanics", "ours": "ours"}
_MARKERS = {"MuJoCo flex": "s", "MuJoCo flex, cells": "D", "Newton VBD": "^"}


Key = tuple[str, str, str, str, int, int]


@dataclass(frozen=True)
class Row:
    """One engine with one setting in one scene. off: RMS distance of the surface nodes from the reference [m]; force:
    RMS distance of the force [N], bearing: RMS of the reference's; depth: of the surface in the collider, its largest,
    and its median of the frames in contact [m]; cpu, wall: seconds for a simulated second; ended: why it stopped early,
    empty if it did not."""

    scene: str
    engine: str
    law: str
    note: str
    step: float
    iterations: int
    off: float
    force: float
    bearing: float
    depth: float
    usual_depth: float
    cpu: float
    wall: float
    ended: str

    @property
    def key(self) -> Key:
        """What distinguishes it from the other rows."""
        return key_of(self.scene, self)


def key_of(scene: str, own: Row | Setting) -> Key:
    """Of a row: scene, engine, law, note, step in nanoseconds and iterations."""
    return scene, own.engine, own.law, own.note, round(1e9 * own.step), own.iterations


def rms(vectors: Array) -> float:
    """sqrt(mean |v|^2) of vectors (..., 3); NaN of none."""
    return float(np.sqrt(np.square(vectors).sum(axis=-1).mean())) if vectors.size else float("nan")


def row(scene: Scene, setting: Setting, played: Played, reference: Played) -> Row:
    """Over the frames in which the reference is in contact; of a run that ended early, those that there are."""
    frames = len(played.x)
    there = np.flatnonzero(reference.force[:frames].any(axis=1))
    surface = scene.body.mesh.surface_nodes
    depth = played.depth[there]
    return Row(
        scene.name,
        setting.engine,
        setting.law,
        setting.note,
        setting.step,
        setting.iterations,
        rms((played.x[there] - reference.x[there])[:, surface]),
        rms(played.force[there] - reference.force[there]),
        rms(reference.force[reference.force.any(axis=1)]),
        float(depth.max(initial=0.0)),
        float(np.median(depth)) if depth.size else 0.0,
        played.cpu / played.simulated,
        played.wall / played.simulated,
        played.ended,
    )


def table(rows: Sequence[Row]) -> str:
    """In Markdown, of one scene."""
    heads = ["engine", "law", "setting", "step, ms", "iterations", "off, mm", "of bare's", "force off"]
    heads += ["depth, mm: largest, median", "CPU-s per s", "wall-s per s", "ended"]
    bare = next((own.off for own in rows if own.engine == "bare"), float("nan"))
    lines = ["| " + " | ".join(heads) + " |", "| --- " * len(heads) + "|"]
    for own in rows:
        cells = [
            own.engine,
            own.law,
            own.note,
            f"{1e3 * own.step:.2f}",
            str(own.iterations or ""),
            f"{1e3 * own.off:.3f}",
            f"{own.off / bare:.1%}",
            f"{own.force / own.bearing:.1%}",
            f"{1e3 * own.depth:.2f}, {1e3 * own.usual_depth:.2f}",
            f"{own.cpu:.1f}",
            f"{own.wall:.1f}",
            own.ended or "completed",
        ]
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines)


def read(path: Path) -> dict[Key, Row]:
    """The finished rows of an earlier run; none where there is no file."""
    if not path.is_file():
        return {}
    rows = [Row(**own) for own in json.loads(path.read_text(encoding="utf-8"))["rows"]]
    return {own.key: own for own in rows}


def write(path: Path, rows: Sequence[Row], told: Mapping[str, object]) -> None:
    """As JSON, under its name once it is whole; told: versions, machine and forces."""
    text = json.dumps({**told, "rows": [asdict(own) for own in rows]}, indent=1)
    with atomic_path(path) as part:
        part.write_text(text, encoding="utf-8")


def draw(rows: Sequence[Row], path: Path) -> None:
    """Error over cost, one panel for each scene; runs that did not complete are crosses at the top."""
    scenes = list(dict.fromkeys(own.scene for own in rows))
    figure = Figure(figsize=(5.4 * len(scenes), 4.4), layout="constrained")
    known = styles_for(_STYLES.values())
    for axis, scene in zip(np.atleast_1d(figure.subplots(1, len(scenes))), scenes, strict=True):
        mine = [own for own in rows if own.scene == scene]
        highest = 2e3 * max(own.off for own in mine if not own.ended)
        for engine in dict.fromkeys(own.engine for own in mine):
            done = sorted((own for own in mine if own.engine == engine), key=lambda own: own.cpu)
            style = known.get(_STYLES.get(engine, ""))
            colour = style.light if style else _COLOURS[engine]
            label, marker = style.label if style else engine, _MARKERS.get(engine, "o")
            whole = [own for own in done if not own.ended]
            axis.plot(
                [own.cpu for own in whole],
                [1e3 * own.off for own in whole],
                marker,
                color=colour,
                label=label,
                markersize=5,
                linestyle=style.dash if style else "none",
            )
            lost = [own.cpu for own in done if own.ended]
            axis.plot(lost, [highest] * len(lost), "x", color=colour, markersize=7)
        axis.set_xscale("log")
        axis.set_yscale("log")
        axis.set_title(scene, fontsize=10)
        axis.set_xlabel("CPU seconds for a simulated second", fontsize=9)
        axis.set_ylabel("surface off from converged full space [mm, RMS]", fontsize=9)
        axis.axvline(1.0, color="#bbbbbb", linewidth=0.8)
        axis.grid(True, which="major", color="#e6e6e6", linewidth=0.6)
        axis.set_axisbelow(True)
        axis.legend(fontsize=8, frameon=False)
    figure.savefig(path, dpi=110)
