"""Films: a motion drawn frame by frame, as an animated GIF or as MP4 (H.264).

The camera stays where everything is seen in all frames. A GIF has one palette for the whole film, chosen from a few of
its frames; its library holds all frames until the end, one byte a pixel. MP4 is encoded as it is drawn.
"""

from __future__ import annotations

import io
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO

import numpy as np
from numpy.typing import NDArray

from softprint.runtime.convert.frames import Frame, SurfaceMotion
from softprint.runtime.drawing.film.flat import FlatStage
from softprint.runtime.drawing.film.solid import SolidStage
from softprint.runtime.drawing.film.subject import Cut, Subject
from softprint.runtime.errors import SoftprintError
from softprint.runtime.io.files import atomic_path

if TYPE_CHECKING:
    from PIL import Image

Pixels = NDArray[np.uint8]

_GIF_WIDTH, _MP4_WIDTH = 640, 1280  # pixels
_WIDTHS = (64, 4096)
_SHAPE = 0.75  # height for each width
_COLOURS = 192  # of a GIF's palette
_PALETTE_FRAMES = 6
_TICK = 100  # a GIF counts the time in hundredths of a second
GIF_FASTEST = 50.0  # frames a second: players slow down frames of less than two ticks
_WHITE = 255
_QUALITY = "18"  # of H.264: no visible loss


@dataclass(frozen=True)
class FilmLook:
    """How films look. width [pixels] of the pictures, None for that of the format; cut: the axis (0, 1, 2) and the
    coordinate [m] of a plane that a 3D body is cut open at."""

    width: int | None = None
    cut: tuple[int, float] | None = None


def write_gif(
    out: Path, motion: SurfaceMotion, progress: Callable[[int], None], look: FilmLook
) -> list[Path]:
    """Write OUT.gif; returns its path."""
    with atomic_path(out) as temporary, temporary.open("wb") as file:
        save_gif(file, motion, look, progress)
    return [out]


def save_gif(file: BinaryIO, motion: SurfaceMotion, look: FilmLook, progress: Callable[[int], None]) -> None:
    """Write an animated GIF that repeats for ever."""
    with open_stage(motion, look, _GIF_WIDTH) as stage:
        palette = _palette(motion, stage)

        def pictures() -> Iterator[Image.Image]:
            for frame in motion.frames():
                yield _indexed(pixels_of(stage, frame), palette)
                progress(1)

        film = pictures()
        next(film).save(
            file,
            format="GIF",
            save_all=True,
            append_images=film,
            duration=_durations(len(motion), motion.rate),
            loop=0,
            optimize=False,
        )


def write_mp4(
    out: Path, motion: SurfaceMotion, progress: Callable[[int], None], look: FilmLook
) -> list[Path]:
    """Write OUT.mp4; returns its path."""
    import av

    rate = Fraction(motion.rate).limit_denominator(1000)
    with (
        atomic_path(out) as temporary,
        open_stage(motion, look, _MP4_WIDTH) as stage,
        av.open(str(temporary), "w", format="mp4", options={"movflags": "faststart"}) as container,
    ):
        stream = container.add_stream("libx264", rate=rate, options={"crf": _QUALITY})
        stream.width, stream.height = _size(_MP4_WIDTH if look.width is None else look.width)
        stream.pix_fmt = "yuv420p"
        for frame in motion.frames():
            picture = av.VideoFrame.from_ndarray(
                np.ascontiguousarray(pixels_of(stage, frame)), format="rgb24"
            )
            container.mux(stream.encode(picture))
            progress(1)
        container.mux(stream.encode())
    return [out]


Stage = SolidStage | FlatStage


def open_stage(motion: SurfaceMotion, look: FilmLook, width: int) -> AbstractContextManager[Stage]:
    """Where the frames are drawn; width: in pixels, where the look has none. Raises SoftprintError if no pictures can
    be drawn here, or none of this look."""
    size = _size(width if look.width is None else look.width)
    if look.cut is not None and motion.dim == 2:
        raise SoftprintError(f"{motion.source.label}: is in 2D, where nothing is cut open: leave out --cut")
    extent = motion.extent
    solids = {
        name: (extent.middles[name], vertices, facets) for name, (vertices, facets) in motion.solids.items()
    }
    subject = Subject(
        motion.source.rest,
        motion.nodes,
        motion.triangles,
        motion.outline,
        solids,
        extent.outermost,
        motion.colouring.label if motion.colouring is not None else None,
        extent.top,
        None if look.cut is None else Cut(*look.cut),
    )
    return SolidStage(subject, size) if motion.dim == 3 else FlatStage(subject, size)


def _size(width: int) -> tuple[int, int]:
    """Width and height [pixels], both even, as H.264 has them."""
    if not _WIDTHS[0] <= width <= _WIDTHS[1]:
        raise SoftprintError(f"--width must be from {_WIDTHS[0]} to {_WIDTHS[1]} pixels, not {width}")
    return width // 2 * 2, round(_SHAPE * width) // 2 * 2


def png_of(pixels: Pixels) -> bytes:
    """A PNG file's bytes."""
    from PIL import Image

    buffer = io.BytesIO()
    Image.fromarray(pixels).save(buffer, format="PNG", optimize=True)
    return buffer.getvalue()


def pixels_of(stage: Stage, frame: Frame) -> Pixels:
    """(height, width, 3) of one frame."""
    return stage.draw(frame.positions, frame.poses, frame.values)


def _palette(motion: SurfaceMotion, stage: Stage) -> Image.Image:
    """A palette for all frames, from what some of them show on the white background, which stays white."""
    from PIL import Image

    chosen = np.unique(np.linspace(0, len(motion) - 1, _PALETTE_FRAMES).round().astype(int))
    sheet = np.concatenate([pixels_of(stage, frame) for frame in motion.frames(chosen.tolist())])
    # Each colour once, so that those of small things count.
    shown = np.unique(sheet[(sheet < _WHITE).any(axis=2)], axis=0)
    few = Image.fromarray(shown.reshape(1, -1, 3)).quantize(_COLOURS - 1, method=Image.Quantize.MEDIANCUT)
    colours = [_WHITE] * 3 + (few.getpalette() or [])[: 3 * (_COLOURS - 1)]
    palette = Image.new("P", (1, 1))
    palette.putpalette(colours)
    return palette


def _indexed(pixels: Pixels, palette: Image.Image) -> Image.Image:
    from PIL import Image

    indexed = Image.fromarray(pixels).quantize(palette=palette, dither=Image.Dither.NONE)
    # The nearest colour is searched for roughly, and a background that is nearly white would be seen.
    background = Image.fromarray(np.uint8(_WHITE) * (pixels == _WHITE).all(axis=2))
    indexed.paste(0, mask=background)
    return indexed


def _durations(count: int, rate: float) -> list[int]:
    """Milliseconds that each frame is shown, in whole ticks whose sum is that of the film."""
    ends = np.round(np.arange(count + 1) * _TICK / rate)
    return [int(ticks) * (1000 // _TICK) for ticks in np.diff(ends)]
