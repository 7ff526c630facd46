"""Formulas in code notation, such as `mu J^(-2/3)`, as HTML: Greek letters, superscripts, subscripts."""

from __future__ import annotations

import re

from markupsafe import Markup, escape

_GREEK = {
    "mu": "μ",
    "lambda": "λ",
    "kappa": "κ",
    "nu": "ν",
    "gamma": "γ",
    "Psi": "Ψ",
    "sum": "Σ",
    "integral": "∫",
}
_WORD = re.compile(rf"(?<![A-Za-z])({'|'.join(_GREEK)})(?=[_\d\W]|$)")
_ABOVE = re.compile(r"\^(?:\(([^()]+)\)|(-?\w+))")
_BELOW = re.compile(r"(?<![A-Za-z])([A-Za-zμλκνγΨΣ])_(\w+(?:[+-]\d)?)")
_SIGNS = {"(x)": "⊗", " - ": " − ", "&lt;=": "≤", "&gt;=": "≥"}


def typeset(text: str) -> Markup:
    """The text as safe HTML with typeset formulas."""
    html = str(escape(text))
    html = _WORD.sub(lambda match: _GREEK[match[1]], html)
    html = _BELOW.sub(r"\1<sub>\2</sub>", html)
    html = _ABOVE.sub(lambda match: f"<sup>{(match[1] or match[2]).replace('-', '−')}</sup>", html)
    for sign, shown in _SIGNS.items():
        html = html.replace(sign, shown)
    return Markup(html)
