"""Blunt parts of a collider against contact points of the body that a dent draws apart.

What is sharper than the gaps between contact points has points of its own (`runtime/colliders/sharp_points.py`). A
blunter tip is felt by the contact points around it, until its dent has stretched the surface so far that it fits
between them: they slide off its sides, and it goes in. So it has points, too, of which the more bears, the wider the
gaps are in the deformed surface: with the stretch lambda of the nearest facet, and that at which the part fits,
lambda_0 = r / r_0 of its radius r and the largest radius r_0 that fits at rest,

    share = min(1, max(0, (lambda / lambda_0 - 1) / 2)).

On a capsule pressed into a block by four times its radius the force then grows without a gap; contact points alone lose
it where lambda is 0.97 to 1.13 lambda_0. With twice the share the force drops no less where the points begin to bear,
and the motions of demo and Finger, where the contact points around them still bear, too, are farther from full space.
"""

from __future__ import annotations

import numpy as np

from softprint.runtime.arrays import Array, IntArray
from softprint.runtime.compiled import compiled

#: Parts have such points up to so many times the radius of sharp ones (full space), or that fits at rest (condensed).
BLUNT = 6.0
# All of the area of a point bears where the stretch is larger than it needs by this factor more.
_WIDER = 2.0


def bearing_share(needed: Array, stretch: Array) -> Array:
    """How much (j,) of the area of sharp points bears, each near a facet that is stretched by a factor (j,). needed:
    lambda_0 (j,), 0 on tips, edges and limbs that fit at rest."""
    return np.clip((stretch / np.maximum(needed, 1e-3) - 1.0) / _WIDER, 0.0, 1.0)


def _longest(x: Array, facets: IntArray) -> Array:
    corners = x[facets]
    return np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1)


@compiled(reference=_longest)
def longest_edges(x: Array, facets: IntArray) -> Array:
    """The longest edge (f,) [m] of facets (f, dim) of nodes at x (n, dim) [m]; over that at rest, their stretch."""
    longest = np.zeros(len(facets))
    for f in range(len(facets)):
        for c in range(facets.shape[1]):
            squared = 0.0
            for a in range(x.shape[1]):
                squared += (x[facets[f, c], a] - x[facets[f, c - 1], a]) ** 2
            longest[f] = max(longest[f], squared)
    return np.sqrt(longest)
