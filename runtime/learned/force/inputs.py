"""What the network of a `ForceModel` is told of each load in contact, and in which directions it may push.

Everything is made of vectors that belong to the contact itself, at each load x,

    g = grad s(x), g' = grad s(x + u)   of the signed distance, before and after the linear body has given way by u,
    N                                   the surface normal that the body carries along,
    H, H'                               the Hessians of the distance there: how the collider is curved,
    C = F^T F, B = F F^T                how the body is strained,

which enter only as products with each other, so that turning body and collider together changes nothing; and means of
these over the loads around,

    <q> = sum_k K w_k q_k / sum_k K w_k,    K = (1 - |x_k - x|^2 / r^2)^2 within r = 2 band,

w_k the weight by which a load takes part at all, so that none enters or leaves abruptly. Over loads in contact these
see as much of the collider's shape as touches the body, for nothing. Distances sampled on rings about g around every
load, the descriptor of the thesis made invariant, were tried beside curvature and strain: shapes learned from were
fitted better, others not, which know the collider where it touches already.
"""

from __future__ import annotations

import numpy as np

from runtime.arrays import Array
from runtime.compiled import compiled, summing

# g, N and u / band.
DIRECTIONS = 3
_INVARIANTS, _MEANS = 28, 13
# r in bands.
RANGE = 2.0


def n_contact_inputs(dim: int) -> int:
    """Columns of `contact_inputs`, `inputs_around` and the rest position together."""
    return _INVARIANTS + _MEANS + dim


# Columns without a unit: slopes and products of directions, strains. They count as spread by at least so much, however
# little they vary where a model learns: a body that was strained by 1 % may be strained by 10 % later.
_WITHOUT_UNIT = (*range(2, 7), *range(11, 17))
_LEAST_SPREAD = 0.1


def least_spread(dim: int) -> Array:
    """What the spread of every input is at least, for normalisation."""
    least = np.zeros(n_contact_inputs(dim))
    least[list(_WITHOUT_UNIT)] = _LEAST_SPREAD
    return least


@compiled
def _form(a: Array, M: Array, b: Array) -> float:
    """a . M b."""
    total = 0.0
    for i in range(len(a)):
        for j in range(len(b)):
            total += a[i] * M[i, j] * b[j]
    return total


@compiled
def _dot(a: Array, b: Array) -> float:
    total = 0.0
    for i in range(len(a)):
        total += a[i] * b[i]
    return total


@compiled
def contact_inputs(
    value: Array, gradient: Array, hessian: Array, moved: Array, F: Array, carried: Array, normal: Array
) -> Array:
    """The invariants (m, _INVARIANTS) of m loads, all vectors in the same axes.

    value (2m,) [m], gradient (2m, dim), hessian (2m, dim, dim) [1/m]: of the signed distance at the loads, and again
    where the linear body has moved them to; moved: u (m, dim) [m]; F: (m, dim, dim); carried: N (m, dim); normal: of
    the surface at rest (m, dim).
    """
    m, dim = moved.shape
    result = np.empty((m, _INVARIANTS))
    C, B = np.empty((dim, dim)), np.empty((dim, dim))
    along = np.empty(dim)
    for j in range(m):
        g, after, u, N = gradient[j], gradient[m + j], moved[j], carried[j]
        H, H_after = hessian[j], hessian[m + j]
        trace_C = trace_H = trace_after = square = square_after = 0.0
        for a in range(dim):
            along[a] = u[a] - _dot(u, N) * N[a]
            trace_H += H[a, a]
            trace_after += H_after[a, a]
            for b in range(dim):
                C[a, b] = B[a, b] = 0.0
                square += H[a, b] ** 2
                square_after += H_after[a, b] ** 2
                for c in range(dim):
                    C[a, b] += F[j, c, a] * F[j, c, b]
                    B[a, b] += F[j, a, c] * F[j, b, c]
            trace_C += C[a, a]
        row = result[j]
        row[0], row[1] = value[j], -value[m + j]
        row[2], row[3], row[4] = np.sqrt(_dot(g, g)), np.sqrt(_dot(after, after)), _dot(g, after)
        row[5], row[6] = _dot(g, N), _dot(after, N)
        row[7], row[8], row[9], row[10] = _dot(u, g), _dot(u, after), _dot(u, N), np.sqrt(_dot(u, u))
        # How the body is strained.
        row[11], row[12], row[13] = _form(normal[j], C, normal[j]), trace_C, np.linalg.det(F[j])
        row[14], row[15], row[16] = _form(g, B, g), _form(g, B, N), _form(along, B, along)
        # How the collider is curved.
        row[17], row[18], row[19], row[20] = trace_H, trace_after, np.sqrt(square), np.sqrt(square_after)
        row[21], row[22] = _form(N, H, N), _form(N, H_after, N)
        row[23], row[24] = _form(u, H, u), _form(u, H_after, u)
        row[25], row[26] = _form(along, H, N), _form(along, H_after, N)
        row[27] = np.sqrt(_dot(along, along))
    return result


@summing
def inputs_around(
    x: Array, weight: Array, value: Array, gradient: Array, moved: Array, carried: Array, reach: float
) -> Array:
    """The means (m, _MEANS) around each of m loads at x (m, dim) [m] with weights w (m,); reach: r [m]; the rest as
    for `contact_inputs`."""
    m, dim = x.shape
    result = np.zeros((m, _MEANS))
    # What is summed, one after the other in memory: a thousand loads have a million pairs.
    told = np.empty((4 + 4 * dim, m))
    for k in range(m):
        told[0, k], told[1, k] = value[k], value[m + k]
        told[2, k], told[3, k] = max(-value[k], 0.0), max(-value[m + k], 0.0) ** 2
        for a in range(dim):
            told[4 + a, k], told[4 + dim + a, k] = x[k, a], moved[k, a]
            told[4 + 2 * dim + a, k], told[4 + 3 * dim + a, k] = carried[k, a], gradient[m + k, a]
    share, mean = np.empty(m), np.empty(4 + 4 * dim)
    for j in range(m):
        share[:] = 0.0
        for a in range(dim):
            along = told[4 + a]
            for k in range(m):
                share[k] += (along[k] - x[j, a]) ** 2
        total = 0.0
        for k in range(m):
            share[k] = weight[k] * max(1.0 - share[k] / reach**2, 0.0) ** 2
            total += share[k]
        if total == 0.0:
            continue  # at the edge of the band, where a load bears nothing
        for q in range(len(mean)):
            summed, column = 0.0, told[q]
            for k in range(m):
                summed += share[k] * column[k]
            mean[q] = summed / total
        centre = mean[4 : 4 + dim] - x[j]
        u, N = mean[4 + dim : 4 + 2 * dim], mean[4 + 2 * dim : 4 + 3 * dim]
        after = mean[4 + 3 * dim :]
        row = result[j]
        row[0], row[1], row[2], row[3] = mean[0] - value[j], value[m + j] - mean[1], mean[2], mean[3]
        row[4] = np.sqrt(_dot(centre, centre))
        row[5], row[6] = _dot(centre, gradient[j]), _dot(centre, moved[j])
        row[7], row[8] = _dot(u, carried[j]), _dot(u, moved[j])
        row[9], row[10] = _dot(after, gradient[m + j]), _dot(after, gradient[j])
        row[11], row[12] = _dot(N, carried[j]), _dot(N, gradient[j])
    return result
