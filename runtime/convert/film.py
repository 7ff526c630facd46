"""Films: a motion drawn frame by frame, as an animated GIF or as MP4 (H.264).

The camera stays where everything is seen in all frames. A GIF has one palette for the whole film, chosen from a few of
its frames; its library holds all frames until the end, one byte a pixel. MP4 is encoded as it is drawn.
"""

from __future__ import annotations

import io
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager
from fractions import Fraction
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO

import numpy as np
from numpy.typing import NDArray

from softprint.runtime.convert.frames import Frame, SurfaceMotion
from softprint.runtime.drawing.film.flat import FlatStage
from softprint.runtime.drawing.film.solid import SolidStage
from softprint.runtime.drawing.film.subject import Subject
from softprint.runtime.io.files import atomic_path

if TYPE_CHECKING:
    from PIL import Image

Pixels = NDArray[np.uint8]

GIF_WIDTH, MP4_WIDTH = 640, 1280  # pixels
_SHAPE = 0.75  # height for each width
_COLOURS = 192  # of a GIF's palette
_PALETTE_FRAMES = 6
_TICK = 100  # a GIF counts the time in hundredths of a second
_SHORTEST = 2  # ticks: players slow down what is faster
_WHITE = 255
_QUALITY = "18"  # of H.264: no visible loss


def write_gif(out: Path, motion: SurfaceMotion, progress: Callable[[int], None]) -> list[Path]:
    """Write OUT.gif; returns its path."""
    with atomic_path(out) as temporary, temporary.open("wb") as file:
        save_gif(file, motion, GIF_WIDTH, progress)
    return [out]


def save_gif(file: BinaryIO, motion: SurfaceMotion, width: int, progress: Callable[[int], None]) -> None:
    """Write an animated GIF of that width [pixels] that repeats for ever."""
    with open_stage(motion, width) as stage:
        palette = _palette(motion, stage)

        def pictures() -> Iterator[Image.Image]:
            for frame in motion.frames():
                yield _indexed(_pixels(stage, frame), palette)
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


def write_mp4(out: Path, motion: SurfaceMotion, progress: Callable[[int], None]) -> list[Path]:
    """Write OUT.mp4; returns its path."""
    import av

    rate = Fraction(motion.rate).limit_denominator(1000)
    with (
        atomic_path(out) as temporary,
        open_stage(motion, MP4_WIDTH) as stage,
        av.open(str(temporary), "w", format="mp4", options={"movflags": "faststart"}) as container,
    ):
        stream = container.add_stream("libx264", rate=rate, options={"crf": _QUALITY})
        stream.width, stream.height, stream.pix_fmt = MP4_WIDTH, round(_SHAPE * MP4_WIDTH), "yuv420p"
        for frame in motion.frames():
            picture = av.VideoFrame.from_ndarray(np.ascontiguousarray(_pixels(stage, frame)), format="rgb24")
            container.mux(stream.encode(picture))
            progress(1)
        container.mux(stream.encode())
    return [out]


Stage = SolidStage | FlatStage


def open_stage(motion: SurfaceMotion, width: int) -> AbstractContextManager[Stage]:
    """Where the frames are drawn. Raises SoftprintError if pictures cannot be drawn here."""
    extent = motion.extent
    solids = {
        name: (extent.middles[name], vertices, facets) for name, (vertices, facets) in motion.solids.items()
    }
    label = motion.colouring.label if motion.colouring is not None else None
    subject = Subject(
        motion.rest,
        motion.triangles,
        motion.outline,
        solids,
        extent.outermost,
        label,
        extent.top,
    )
    size = width, round(_SHAPE * width)
    return SolidStage(subject, size) if motion.dim == 3 else FlatStage(subject, size)


def png_of(pixels: Pixels) -> bytes:
    """A PNG file's bytes."""
    from PIL import Image

    buffer = io.BytesIO()
    Image.fromarray(pixels).save(buffer, format="PNG", optimize=True)
    return buffer.getvalue()


def _pixels(stage: Stage, frame: Frame) -> Pixels:
    return stage.draw(frame.points, frame.poses, frame.values)


def _palette(motion: SurfaceMotion, stage: Stage) -> Image.Image:
    """A palette for all frames, from what some of them show on the white background, which stays white."""
    from PIL import Image

    chosen = np.unique(np.linspace(0, len(motion) - 1, _PALETTE_FRAMES).round().astype(int))
    sheet = np.concatenate([_pixels(stage, frame) for frame in motion.frames(chosen.tolist())])
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
    ticks = np.maximum(np.diff(ends), _SHORTEST)
    return [int(tick) * (1000 // _TICK) for tick in ticks]
