"""How much of a learned correction is kept: as much as contacts bear out that its network was not trained on.

Networks are trained on parts of the samples, and judged on the rest, with contacts, states and shapes of its own. On
part k, with what linear mechanics misses m and the correction c, fields over the volume,

    x_k = sum <c, m>,    q_k = sum <c, c>,    |m - s c|^2 = |m|^2 - 2 s x + s^2 q,

so that the share s = sum x / sum q of the correction has the least error. That is an estimate, from networks and
contacts of which there are few; what is kept is the share less its standard error (of a ratio, Cochran 1977, 6.4),

    s = sum x / sum q - e,    e^2 = K / (K - 1) sum_k (x_k - s q_k)^2 / (sum q)^2,

between 0, where linear mechanics remains, and 1. Near the best share the error is flat: a third less than that has nine
tenths of the gain.
"""

from __future__ import annotations

import numpy as np

from softprint.runtime.arrays import Array


def kept_part(cross: Array, square: Array) -> float:
    """s from x (K,) and q (K,) of at least two parts; 0 for a correction of zero."""
    whole = float(square.sum())
    if whole <= 0.0:
        return 0.0
    best, parts = float(cross.sum()) / whole, len(square)
    off = np.square(cross - best * square).sum()
    error = np.sqrt(off * parts / max(parts - 1, 1)) / whole
    return float(np.clip(best - error, 0.0, 1.0))
