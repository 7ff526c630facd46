"""A motion as moving pictures in memory, for notebooks."""

from __future__ import annotations

import io

import numpy as np

from softprint.runtime.convert.film import FilmLook, open_stage, pixels_of, png_of, save_gif
from softprint.runtime.convert.frames import surface_motion
from softprint.runtime.convert.recorded import Recorded
from softprint.runtime.convert.sampling import Sampling
from softprint.runtime.drawing.picture import Animation, Picture

_RATE = 20.0  # frames a second: a notebook holds the film as text
_MOST = 200  # frames


def animation_of(source: Recorded, colour: str, width: int) -> Animation:
    """All of a motion, at fewer frames a second if it is long. Raises SoftprintError if it cannot be drawn."""
    length = float(source.times[-1] - source.times[0])
    rate = min(_RATE, (_MOST - 1) / length) if length > 0 else _RATE
    motion = surface_motion(source, Sampling(rate=rate), colour)
    buffer, look = io.BytesIO(), FilmLook(width)
    save_gif(buffer, motion, look, lambda n: None)
    # The still is the frame in which the body has moved most.
    moved = [float(np.abs(frame.points - motion.rest).max()) for frame in motion.frames()]
    with open_stage(motion, look, width) as stage:
        (frame,) = motion.frames([int(np.argmax(moved))])
        still = Picture(png_of(pixels_of(stage, frame)), source.label)
    return Animation(buffer.getvalue(), still)
