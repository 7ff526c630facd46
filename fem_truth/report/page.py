"""The page: one self-contained HTML text. All its numbers come from the JSON summary.

Every number on the page is written by `Numbers`, which looks it up in the summary by its path and emits
`<data value="..." data-key="path">`, so that page and JSON cannot disagree and a reader can find the full digits.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from importlib import resources
from typing import Any

from jinja2 import Environment, FunctionLoader, StrictUndefined, Template
from markupsafe import Markup, escape

from softprint.fem_truth.report.drawing.picture import Picture
from softprint.fem_truth.report.drawing.style import ModelStyle
from softprint.runtime.drawing.colours import ERROR_COLOURS

_THIN_SPACE = "\u202f"


@dataclass(frozen=True)
class ShownFrame:
    """The pictures of one frame: rows of views, one cell per model (None if there is no picture)."""

    index: int  # in scenes/N/shown of the summary, which has the frame's numbers
    frame: int
    why: str
    models: Sequence[str]
    outside: Sequence[Picture | None]
    cut: Sequence[Picture | None]
    heat: Sequence[Picture | None]


@dataclass(frozen=True)
class ScenePictures:
    """Plots (SVG text) by name and pictures of frames of a test scene."""

    plots: Mapping[str, str] = field(default_factory=dict)
    frames: Sequence[ShownFrame] = ()
    description: str = ""


@dataclass(frozen=True)
class ShapeView:
    """The worst sample of one shape: a picture of the whole, and (model, picture) of each cut open, full space
    first."""

    whole: Picture
    cut: Sequence[tuple[str, Picture]]


@dataclass(frozen=True)
class PageContent:
    """All that the template needs: the JSON summary, pictures and plots, and the styles of the models."""

    summary: Mapping[str, Any]
    scenes: Mapping[str, ScenePictures]
    plots: Mapping[str, str]
    styles: Mapping[str, ModelStyle]
    hero: Sequence[tuple[str, Picture]] = ()
    shapes: Sequence[ShapeView] = ()


def render_page(content: PageContent) -> str:
    """The whole page as HTML text."""
    template = page_template("softprint.fem_truth.report", "page.html.j2")
    return template.render(
        s=content.summary,
        n=Numbers(content.summary),
        scenes={name: _safe_plots(pictures) for name, pictures in content.scenes.items()},
        plots={name: Markup(svg) for name, svg in content.plots.items()},
        styles=content.styles,
        hero=content.hero,
        shape_views=content.shapes,
        css=Markup(page_style()),
        model_variables=Markup(_model_variables(content.styles)),
        heat_gradient=", ".join(ERROR_COLOURS),
    )


class Numbers:
    """`n("path/to/value", "percent")` in the template: the number as text, with its exact value in an attribute."""

    def __init__(self, summary: Mapping[str, Any]) -> None:
        self._summary = summary

    def __call__(self, path: str, style: str = "plain") -> Markup:
        value = look_up(self._summary, path)
        if value is None:
            return Markup('<span class="none" title="not available">\u2013</span>')
        return Markup('<data value="{}" data-key="{}">{}</data>').format(
            repr(value), path, format_number(value, style)
        )


def look_up(summary: Mapping[str, Any], path: str) -> Any:
    """The value at a path ("scenes/0/frames"); None if any part of it is missing."""
    value: Any = summary
    for part in path.split("/"):
        if isinstance(value, Mapping):
            value = value.get(part)
        elif (
            isinstance(value, Sequence)
            and not isinstance(value, str)
            and part.isdigit()
            and int(part) < len(value)
        ):
            value = value[int(part)]
        else:
            return None
    return value


def format_number(value: float | int, style: str) -> str:
    """A number as text for the page. Lengths are given in metres and shown in millimetres, times are shown in seconds
    or milliseconds."""
    if style == "int":
        return f"{round(value):,}".replace(",", _THIN_SPACE)
    scale, unit = _SCALES[style]
    return f"{_three_digits(value * scale)}{_THIN_SPACE + unit if unit else ''}"


_SCALES = {
    "plain": (1.0, ""),
    "percent": (100.0, "%"),
    "mm": (1e3, "mm"),
    "um": (1e6, "\u00b5m"),
    "ms": (1e3, "ms"),
    "s": (1.0, "s"),
    "times": (1.0, "\u00d7"),
    "per_second": (1.0, "/s"),
    "gib": (2.0**-30, "GiB"),
    "mib": (2.0**-20, "MiB"),
}


def _three_digits(value: float) -> str:
    """Three significant digits, without exponents between 1e-3 and 1e6."""
    if value == 0:
        return "0"
    size = math.floor(math.log10(abs(value)))
    if size < -3 or size >= 6:
        mantissa, exponent = f"{value:.1e}".split("e")
        return f"{mantissa}\u202f\u00d7\u202f10{str(int(exponent)).translate(_SUPERSCRIPT)}"
    decimals = max(0, 2 - size)
    text = f"{value:,.{decimals}f}"
    return text.replace(",", _THIN_SPACE)


_SUPERSCRIPT = str.maketrans(
    "-0123456789", "\u207b\u2070\u00b9\u00b2\u00b3\u2074\u2075\u2076\u2077\u2078\u2079"
)


def page_style() -> str:
    """The style sheet of all pages that Softprint writes."""
    return template_text("softprint.fem_truth.report", "page.css")


def page_template(package: str, name: str) -> Template:
    """A template of a package's folder `templates`; it may include others of that folder."""
    environment = Environment(
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        loader=FunctionLoader(lambda included: template_text(package, included)),
    )
    return environment.get_template(name)


def template_text(package: str, name: str) -> str:
    """A file of a package's folder `templates`."""
    return resources.files(package).joinpath("templates", name).read_text(encoding="utf-8")


def _safe_plots(pictures: ScenePictures) -> ScenePictures:
    """SVG text made by `figures` needs no escaping."""
    plots = {name: Markup(svg) for name, svg in pictures.plots.items()}
    return ScenePictures(plots, pictures.frames, pictures.description)


def _model_variables(styles: Mapping[str, ModelStyle]) -> str:
    light = "".join(f"{escape(style.variable)}:{style.light};" for style in styles.values())
    dark = "".join(f"{escape(style.variable)}:{style.dark};" for style in styles.values())
    return (
        f":root {{ {light} }}\n"
        f"@media (prefers-color-scheme: dark) {{ :root {{ {dark} }} }}\n"
        f"@media print {{ :root {{ {light} }} }}"
    )
