"""Pictures as bytes that can be embedded in a page, and the interface of renderers."""

import base64
import io
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from softprint.runtime.arrays import Array
from softprint.runtime.colliders.pose import RigidPose

_QUALITY = 88  # of WebP: no visible loss on smooth shading, a tenth of the size of PNG


@dataclass(frozen=True)
class Picture:
    """An encoded picture, its size in pixels, and a text alternative for those who cannot see it."""

    data: bytes
    mime: str
    width: int
    height: int
    alt: str

    @property
    def uri(self) -> str:
        """The picture as a data URI, which is shown without loading a file."""
        return f"data:{self.mime};base64,{base64.b64encode(self.data).decode('ascii')}"


def encode(pixels: NDArray[np.uint8], alt: str) -> Picture:
    """Encode (height, width, 3 or 4) pixels; the fourth channel is opacity."""
    image = Image.fromarray(pixels)
    buffer = io.BytesIO()
    image.save(buffer, format="WEBP", quality=_QUALITY, method=2)
    return Picture(buffer.getvalue(), "image/webp", image.width, image.height, alt)


class Renderer(Protocol):
    """Draws one body at given positions, always from the same camera, on a transparent background."""

    description: str  # a sentence for the page that names the drawing library

    def outside(self, positions: Array, pose: RigidPose, alt: str) -> Picture:
        """The whole body at positions (n_nodes, dim), with the collider at `pose` half transparent."""
        ...

    def cut(self, positions: Array, pose: RigidPose, centre: Array, alt: str) -> Picture | None:
        """A close-up of the contact around `centre` (dim,), cut open; None if this renderer cannot cut."""
        ...

    def heat(self, positions: Array, values: Array, limit: float, alt: str) -> Picture:
        """The body coloured by values (n_nodes,) from 0 to `limit`, without the collider."""
        ...
