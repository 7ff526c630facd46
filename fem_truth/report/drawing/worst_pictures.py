"""Small pictures of the worst shapes of a report, extracted from the images embedded in its page."""

from __future__ import annotations

import base64
import io
from collections.abc import Sequence
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
from PIL import Image

from softprint.fem_truth.report.drawing.picture import Picture, encode

# Pixels: five are shown side by side.
_WIDTH = 340


def worst_pictures(page: Path) -> list[list[Picture]]:
    """For every shape on the page, worst first: the contact, full space cut open, and the judged model. Empty for a
    page without pictures."""
    if not page.is_file():
        return []
    reader = _Shapes()
    reader.feed(page.read_text(encoding="utf-8"))
    # The bare subspace is between full space and the judged model.
    return [[_small(*shape[at]) for at in (0, 1, -1)] for shape in reader.shapes if len(shape) > 2]


class _Shapes(HTMLParser):
    """Pictures (data URI, alt) of every article in the section `shapes`."""

    def __init__(self) -> None:
        super().__init__()
        self.shapes: list[list[tuple[str, str]]] = []
        self._inside = False

    def handle_starttag(self, tag: str, attrs: Sequence[tuple[str, str | None]]) -> None:
        found = dict(attrs)
        if tag == "section":
            self._inside = found.get("id") == "shapes"
        elif self._inside and tag == "article":
            self.shapes.append([])
        elif self._inside and tag == "img" and self.shapes:
            self.shapes[-1].append((found.get("src") or "", found.get("alt") or ""))


def _small(uri: str, alt: str) -> Picture:
    """A picture of a page, not wider than _WIDTH."""
    with Image.open(io.BytesIO(base64.b64decode(uri.partition("base64,")[2]))) as image:
        image.thumbnail((_WIDTH, image.height), Image.Resampling.LANCZOS)
        return encode(np.asarray(image.convert("RGBA"), dtype=np.uint8), alt)
