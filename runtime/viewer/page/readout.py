"""What the page writes beside the scene: the state of the simulation, the scale of the colours, and notices."""

from __future__ import annotations

from html import escape
from typing import Any

import numpy as np

from softprint.runtime.drawing.colours import ERROR_COLOURS
from softprint.runtime.viewer.page.force_plot import swatch
from softprint.runtime.viewer.processes.frame_info import FrameInfo

GOOD, BAD, PLAIN = "#1a7f37", "#c21f1f", "#57606a"
_BOX = "font-size:0.82em;line-height:1.45;padding:0.15em 0.5em 0.35em"


def status_html(
    infos: list[FrameInfo],
    paused: bool,
    building: str,
    recording: float | None,
    drawn: float,
    confidence: Any,
) -> str:
    """The state of the simulation. drawn: pictures a second; confidence: by collider, of each model."""
    if not infos:
        return f'<div style="{_BOX}">the simulation is being prepared …</div>'
    pace = infos[0].pace
    lines = []
    for number, (info, factors) in enumerate(zip(infos, confidence, strict=True)):
        colour = GOOD if info.good else BAD
        word = "converged" if info.good else info.status.replace("_", " ").lower()
        force = sum(float(np.linalg.norm(own)) for own in info.forces.values())
        told = "".join(f", confidence {factor:.2f}" for factor in factors.values())
        lines.append(
            f"{swatch(number) if len(infos) > 1 else ''}<b>{escape(info.model)}</b>: "
            f'<span style="color:{colour}"><b>{word}</b></span>, '
            f"{info.iterations} Newton, residual {info.residual:.1e}, <b>{force:.2f} N</b>{told}"
        )
        if info.sentence:
            lines.append(f'<span style="color:{BAD}">{escape(info.sentence)}</span>')
    if paused:
        lines.append(f'<span style="color:{PLAIN}">paused at {infos[0].time:.2f} s</span>')
    else:
        lines.append(
            f'<span style="color:{PLAIN}">{infos[0].time:.1f} s · '
            f"{pace.steps:.{0 if pace.steps >= 10 else 1}f} steps/s of {1e3 * pace.cost:.1f} ms "
            f"· {pace.real:.2f} × real time · {drawn:.0f} pictures/s</span>"
        )
    if building:
        lines.append(f'<span style="color:{PLAIN}">preparing {escape(building)} …</span>')
    if recording is not None:
        lines.append(f'<span style="color:{BAD}"><b>● recording</b> {recording:.1f} s</span>')
    return f'<div id="softprint-status" style="{_BOX}">{"<br>".join(lines)}</div>'


def legend_html(quantity: str, top: float, unit: str, above: bool) -> str:
    """The scale of the colours; empty where there is none. above: whether there are values beyond its end."""
    if quantity == "nothing":
        return ""
    stops = ",".join(ERROR_COLOURS)
    last = f"{'≥ ' if above else ''}{top:g}"
    numbers = f"<span>0</span><span>{0.5 * top:g}</span><span>{last}</span>"
    return (
        f'<div style="{_BOX}"><div>{escape(quantity)}{f" [{unit}]" if unit else ""}</div>'
        f'<div style="height:0.7em;border-radius:3px;background:linear-gradient(90deg,{stops})"></div>'
        f'<div style="display:flex;justify-content:space-between">{numbers}</div></div>'
    )


def notice_html(text: str, kind: str) -> str:
    """A sentence to the user."""
    colour = {"good": GOOD, "bad": BAD}.get(kind, PLAIN)
    return f'<div id="softprint-notice" style="{_BOX};color:{colour}">{escape(text)}</div>' if text else ""
