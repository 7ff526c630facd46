"""Runs a notebook as Jupyter does: its cells in order, in one namespace, the last value of each cell shown.

Jupyter's own client would add thirty packages to the tests; notebooks here are plain Python.
"""

from __future__ import annotations

import ast
import json
from pathlib import Path
from typing import Any

_RICH = ("_repr_html_", "_repr_png_")


def cells(path: Path, kind: str = "code") -> list[str]:
    """The sources of its cells of that kind, in order."""
    notebook = json.loads(path.read_text(encoding="utf-8"))
    return ["".join(cell["source"]) for cell in notebook["cells"] if cell["cell_type"] == kind]


def run_notebook(path: Path) -> tuple[dict[str, Any], list[str | bytes]]:
    """What is known at its end, and what its cells show: HTML, PNG, or text."""
    known: dict[str, Any] = {"__name__": "__main__"}
    shown = []
    for number, source in enumerate(cells(path)):
        tree = ast.parse(source, f"{path.name}, cell {number}")
        hidden = source.rstrip().endswith(";")
        last = tree.body.pop() if isinstance(tree.body[-1], ast.Expr) else None
        exec(compile(tree, f"{path.name}, cell {number}", "exec"), known)
        if last is not None:
            value = eval(compile(ast.Expression(last.value), f"{path.name}, cell {number}", "eval"), known)
            if value is not None and not hidden:
                shown.append(_shown(value))
    return known, shown


def _shown(value: Any) -> str | bytes:
    for name in _RICH:
        if hasattr(value, name):
            return getattr(value, name)()
    return repr(value)
