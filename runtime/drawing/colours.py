"""The colours of bodies, colliders and errors, the same in all pictures."""

import numpy as np

from softprint.runtime.arrays import Array

BODY = "#e58a6b"
SECTION = "#f0b39a"
COLLIDER = "#51617c"
ERROR_COLOURS = ("#fbeee0", "#f9c58d", "#f08a57", "#d5474f", "#93246a", "#3f0f58")
# Frames of a body: the palette of Okabe and Ito (2008), which colour-blind readers can distinguish.
FRAMES = ("#0072b2", "#009e73", "#cc79a7", "#e69f00", "#56b4e9")
POINTS = "#1b1b1f"
EDGES = "#7a3420"

_TINY = float(np.finfo(float).tiny)


def rgb(colour: str) -> Array:
    """(3,) red, green and blue from 0 to 1 of "#rrggbb", as displayed (sRGB)."""
    return np.array([int(colour[i : i + 2], 16) for i in (1, 3, 5)]) / 255.0


def error_colours(values: Array, top: float) -> Array:
    """(n, 3) sRGB from 0 to 1 of values (n,) on a scale from 0 to top."""
    stops = np.array([rgb(colour) for colour in ERROR_COLOURS])
    share = np.clip(values / max(top, _TINY), 0.0, 1.0)
    places = np.linspace(0.0, 1.0, len(stops))
    return np.column_stack([np.interp(share, places, stops[:, channel]) for channel in range(3)])


def linear(srgb: Array) -> Array:
    """Displayed colours as amounts of light, which is what files for renderers hold."""
    return np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)
