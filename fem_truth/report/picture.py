"""Pictures as bytes that a page can carry inside itself, and the one interface of whoever draws them."""

import base64
import io
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from runtime.arrays import Array
from runtime.colliders.pose import RigidPose

_QUALITY = 88  # of WebP: no visible loss on smooth shading, a tenth of the size of PNG


@dataclass(frozen=True)
class Picture:
    """An encoded picture, its size in pixels, and what it shows in words (for those who cannot see it)."""

    data: bytes
    mime: str
    width: int
    height: int
    alt: str

    @property
    def uri(self) -> str:
        """As a data URI: nothing has to be fetched to show it."""
        return f"data:{self.mime};base64,{base64.b64encode(self.data).decode('ascii')}"


def encode(pixels: NDArray[np.uint8], alt: str) -> Picture:
    """Encode (height, width, 3 or 4) pixels; a fourth channel is opacity and is kept."""
    image = Image.fromarray(pixels)
    buffer = io.BytesIO()
    image.save(buffer, format="WEBP", quality=_QUALITY, method=5)
    return Picture(buffer.getvalue(), "image/webp", image.width, image.height, alt)


class Renderer(Protocol):
    """Draws one body in any of its positions, always from the same camera, on a transparent background."""

    description: str  # a sentence for the page: with what the pictures were drawn

    def outside(self, positions: Array, pose: RigidPose, alt: str) -> Picture:
        """The whole body at positions (n_nodes, dim), with the collider at `pose` half transparent."""
        ...

    def cut(self, positions: Array, pose: RigidPose, centre: Array, alt: str) -> Picture | None:
        """A close look at the contact around `centre` (dim,), cut open; None where this renderer has no
        cut."""
        ...

    def heat(self, positions: Array, values: Array, limit: float, alt: str) -> Picture:
        """The body coloured by values (n_nodes,) from 0 to `limit`, without the collider."""
        ...
