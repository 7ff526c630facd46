"""The network inputs of a `ForceModel` at each contact point, and the directions of its forces.

All inputs are built from vectors and tensors of the contact itself, at each contact point x,

    g = grad s(x), g' = grad s(x + u)   of the signed distance, before and after the linear displacement u,
    N                                   the deformed surface normal,
    H, H'                               the Hessians of the distance there: curvature of the collider,
    C = F^T F, B = F F^T                strain of the body,

which enter only as products with each other, so that rotating body and collider together changes nothing; and means of
these over the points around,

    <q> = sum_k K w_k q_k / sum_k K w_k,    K = (1 - |x_k - x|^2 / r^2)^2 within r = 2 band,

with w_k the weight of a point, which vanishes smoothly at the edge of the band. Of a point that a sharp point of the
collider presses, s is the distance from the plane there (`contact_state.py`). Over the points in contact these means
describe the shape of the collider where it touches the body, at no extra cost. Distances sampled on rings about g
around every point (the descriptor of the thesis, made invariant) were tested as additional inputs: they fit training
shapes better, but not other shapes.
"""

from __future__ import annotations

import numpy as np

from softprint.runtime.arrays import Array
from softprint.runtime.compiled import compiled, summing

# g, N and u / band.
DIRECTIONS = 3
_INVARIANTS, _MEANS = 28, 13
# r in bands.
RANGE = 2.0


def n_contact_inputs(dim: int) -> int:
    """The number of columns of `contact_inputs`, `inputs_around` and the rest position together."""
    return _INVARIANTS + _MEANS + dim


# Dimensionless columns: slopes and products of directions, strains. For normalisation they have at least this standard
# deviation, however little they vary in training: a body that was strained by 1 % there may be strained by 10 % later.
_WITHOUT_UNIT = (*range(2, 7), *range(11, 17))
_LEAST_SPREAD = 0.1


def least_spread(dim: int) -> Array:
    """The least standard deviation of every input, for normalisation."""
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
    value: Array,
    gradient: Array,
    hessian: Array,
    moved: Array,
    F: Array,
    deformed_normal: Array,
    normal: Array,
) -> Array:
    """The invariants (m, _INVARIANTS) of m points, with all vectors in the same axes.

    value (2m,) [m], gradient (2m, dim), hessian (2m, dim, dim) [1/m]: of the signed distance at the points, and then at
    the points displaced by u; moved: u (m, dim) [m]; F: (m, dim, dim); deformed_normal: N (m, dim); normal: of the
    surface at rest (m, dim).
    """
    m, dim = moved.shape
    result = np.empty((m, _INVARIANTS))
    C, B = np.empty((dim, dim)), np.empty((dim, dim))
    along = np.empty(dim)
    for j in range(m):
        g, after, u, N = gradient[j], gradient[m + j], moved[j], deformed_normal[j]
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
        # Strain of the body.
        row[11], row[12], row[13] = _form(normal[j], C, normal[j]), trace_C, np.linalg.det(F[j])
        row[14], row[15], row[16] = _form(g, B, g), _form(g, B, N), _form(along, B, along)
        # Curvature of the collider.
        row[17], row[18], row[19], row[20] = trace_H, trace_after, np.sqrt(square), np.sqrt(square_after)
        row[21], row[22] = _form(N, H, N), _form(N, H_after, N)
        row[23], row[24] = _form(u, H, u), _form(u, H_after, u)
        row[25], row[26] = _form(along, H, N), _form(along, H_after, N)
        row[27] = np.sqrt(_dot(along, along))
    return result


@summing
def inputs_around(
    x: Array, weight: Array, value: Array, gradient: Array, moved: Array, deformed_normal: Array, reach: float
) -> Array:
    """The means (m, _MEANS) around each of m points at x (m, dim) [m] with weights w (m,); reach: r [m]; the rest as
    for `contact_inputs`."""
    m, dim = x.shape
    result = np.zeros((m, _MEANS))
    # The quantities to average, each contiguous in memory: a thousand points have a million pairs.
    columns = np.empty((4 + 4 * dim, m))
    for k in range(m):
        columns[0, k], columns[1, k] = value[k], value[m + k]
        columns[2, k], columns[3, k] = max(-value[k], 0.0), max(-value[m + k], 0.0) ** 2
        for a in range(dim):
            columns[4 + a, k], columns[4 + dim + a, k] = x[k, a], moved[k, a]
            columns[4 + 2 * dim + a, k] = deformed_normal[k, a]
            columns[4 + 3 * dim + a, k] = gradient[m + k, a]
    share, mean = np.empty(m), np.empty(4 + 4 * dim)
    for j in range(m):
        share[:] = 0.0
        for a in range(dim):
            along = columns[4 + a]
            for k in range(m):
                share[k] += (along[k] - x[j, a]) ** 2
        total = 0.0
        for k in range(m):
            share[k] = weight[k] * max(1.0 - share[k] / reach**2, 0.0) ** 2
            total += share[k]
        if total == 0.0:
            continue  # at the edge of the band, where the weight is zero
        for q in range(len(mean)):
            summed, column = 0.0, columns[q]
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
        row[7], row[8] = _dot(u, deformed_normal[j]), _dot(u, moved[j])
        row[9], row[10] = _dot(after, gradient[m + j]), _dot(after, gradient[j])
        row[11], row[12] = _dot(N, deformed_normal[j]), _dot(N, gradient[j])
    return result
