"""The style of every model: its label, its colours on light and dark pages, its line style, its order.

The colours are those of Okabe and Ito (2008), which colour-blind readers can distinguish; the dark-page
variants are lighter tints of the same hues. Lines also differ in dash, so that the plots are readable in grey.
Figures are drawn with placeholder colours (`paint`) that become CSS variables of the page, so that one
SVG works on light and dark pages.
"""

import re
from collections.abc import Iterable
from dataclasses import dataclass

Dash = str | tuple[float, tuple[float, ...]]
_SOLID: Dash = "-"
_DASHED: Dash = (0.0, (5.0, 2.0))
_DOTTED: Dash = (0.0, (1.5, 1.8))
_DASH_DOT: Dash = (0.0, (6.0, 1.8, 1.5, 1.8))


@dataclass(frozen=True)
class ModelStyle:
    """How a model is shown; `dash` is a matplotlib line style."""

    key: str
    label: str
    explanation: str
    light: str
    dark: str
    dash: Dash = "-"

    @property
    def variable(self) -> str:
        """The CSS variable that holds its colour."""
        return "--m-" + re.sub(r"[^A-Za-z0-9_-]", "-", self.key)

    @property
    def border(self) -> str:
        """The CSS border style that looks like its line, for legends."""
        return {_SOLID: "solid", _DOTTED: "dotted"}.get(self.dash, "dashed")


_KNOWN = (
    ModelStyle("full", "Full space", "the finite-element reference", "#1b1b1f", "#f2f2f0"),
    ModelStyle("bare", "Bare subspace", "U q, nothing added", "#7d828c", "#9aa0ab", _DASHED),
    ModelStyle(
        "linear_response",
        "Linear response",
        "elasticity linearised about the internal equilibrium, null-space constrained",
        "#b57b00",
        "#f0b93a",
        _DASH_DOT,
    ),
    ModelStyle(
        "condensed",
        "Condensed",
        "U q and static condensation, nothing learned",
        "#b57b00",
        "#f0b93a",
        _DASH_DOT,
    ),
    ModelStyle("thesis4", "thesis4", "the thesis's correction (ch. 4)", "#0072b2", "#56b4e9", _DASHED),
    ModelStyle("thesis5", "thesis5", "the thesis's network (ch. 5)", "#0072b2", "#56b4e9", _DASHED),
    ModelStyle("thesis6", "thesis6", "the thesis's network (ch. 6)", "#6a3d9a", "#c3a5e8", _DASHED),
    ModelStyle(
        "quadratic", "Quadratic", "an internal correction, quadratic in the state", "#5b7d1a", "#a9cc63", _SOLID
    ),
    ModelStyle("modes", "Modes", "an internal correction, in elastic equilibrium", "#5b7d1a", "#a9cc63", _DASHED),
    ModelStyle(
        "mechanics",
        "Mechanics",
        "ours before training: linear elasticity",
        "#9b2c4d",
        "#f28ba6",
        _DASH_DOT,
    ),
    ModelStyle(
        "ours", "Ours", "linear mechanics, and a network that corrects it", "#d2500a", "#ff8b4d", _SOLID
    ),
    ModelStyle(
        "truth",
        "Constrained truth",
        "the exact contact displacement at that q, without internal deformation",
        "#00805d",
        "#2fc79a",
        _DOTTED,
    ),
    ModelStyle(
        "statics",
        "Full statics",
        "contact and internal displacement exact: only inertia and friction are missing",
        "#a3487f",
        "#e39ac6",
        _DOTTED,
    ),
)
_SPARE = (("#5b4bb5", "#a79cf0"), ("#2a7f9e", "#7fd0ea"), ("#8a6d3b", "#d8bd8a"))


def styles_for(models: Iterable[str]) -> dict[str, ModelStyle]:
    """A style for every named model; known ones come first, in the order of the error tables."""
    names = list(dict.fromkeys(models))
    known = {style.key: style for style in _KNOWN if style.key in names}
    for i, name in enumerate(sorted(set(names) - set(known))):
        light, dark = _SPARE[i % len(_SPARE)]
        known[name] = ModelStyle(name, name, "another correction file", light, dark, _SOLID)
    return known


# Placeholder colours that no drawing uses otherwise; `figures.to_svg` turns them into CSS variables.
INK = "#010203"
RULE = "#010204"
PAPER = "#010205"


def paint(index: int) -> str:
    """The placeholder colour of the index-th model of a figure."""
    return f"#0103{index:02x}"
