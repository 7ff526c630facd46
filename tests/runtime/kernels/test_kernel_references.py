"""Every compiled kernel against the reference beside it, on random numbers in 2D and 3D."""

from __future__ import annotations

import importlib

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from softprint.runtime.compiled import REFERENCES
from softprint.runtime.mechanics.static_condensation_kernels import SparseModes
from tests.kernel_files import KERNEL_FILES

for _file in KERNEL_FILES:
    importlib.import_module(_file)

M, ROWS = 7, 5  # points, handle rows
# Sums of some hundred products of numbers of order one, in the precision of the kernel.
SINGLE, DOUBLE = 1e-5, 1e-11
ONLY_3D = {
    "softprint.runtime.body.rotations._polar_3d",
    "softprint.runtime.colliders.path._along",
    "softprint.runtime.colliders.path._all_along",
    "softprint.runtime.colliders.surface_mesh.sweep_kernels._squared_distance",
    "softprint.runtime.rigid.free_rotation_kernels.midpoint_equation",
    "softprint.runtime.rigid.free_rotation_kernels.middle_spin",
}
ONLY_2D = {
    "softprint.runtime.body.rotations._polar_2d",
    "softprint.runtime.colliders.sampled.polygon.polygon_distance",
}


def rotations(rng, dim, n=None):
    if dim == 3:
        return Rotation.random(n, random_state=int(rng.integers(1000))).as_matrix()
    angle = rng.uniform(0, 6, () if n is None else n)
    return np.moveaxis(
        np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]), [0, 1], [-2, -1]
    )


def near_identity(rng, dim):
    return np.eye(dim) + 0.2 * rng.normal(size=(M, dim, dim))


def strained(rng, F):
    """F, dJ/dF and two moduli."""
    dJ = np.linalg.det(F)[:, None, None] * np.linalg.inv(F).transpose(0, 2, 1)
    return F, dJ, *rng.uniform(1, 2, (2, M))


def symmetric(rng, dim):
    A = rng.normal(size=(M, dim, dim))
    return A + A.transpose(0, 2, 1)


def symmetric_pairs(rng, dim):
    G = rng.normal(size=(M, M, dim, dim)).astype(np.float32)
    return G + G.transpose(1, 0, 3, 2)


def spins(dim):
    return dim * (dim - 1) // 2


def symmetric_matrix(rng, size):
    """A symmetric matrix in float32."""
    matrix = rng.normal(size=(size, size)).astype(np.float32)
    return matrix + matrix.T


def some(rng, n=M):
    """Indices (4,), one of them twice."""
    return np.append(rng.permutation(n)[:3], 1).astype(np.int64)


def frames(rng, dim):
    return np.concatenate([rotations(rng, dim, M), rng.normal(size=(M, 1, dim))], axis=1)


def generators(dim):
    if dim == 2:
        return np.array([[[0.0, -1.0], [1.0, 0.0]]])
    return np.array(
        [
            [[0, 0, 0], [0, 0, -1], [0, 1, 0]],
            [[0, 0, 1], [0, 0, 0], [-1, 0, 0]],
            [[0, -1, 0], [1, 0, 0], [0, 0, 0.0]],
        ]
    )


def normals(rng, dim):
    n = rng.normal(size=(M, dim))
    return n / np.linalg.norm(n, axis=1, keepdims=True)


def cones(rng, dim):
    p, angle = 4, rng.uniform(-0.3, 0.3, 4)
    axis = rng.normal(size=(p, dim))
    axis /= np.linalg.norm(axis, axis=1, keepdims=True)
    return (
        0.5 * rng.normal(size=(p, dim)),
        axis,
        rng.uniform(0.5, 1, p),
        rng.uniform(0.4, 0.6, p),
        np.sin(angle),
        np.cos(angle),
    )


def grid(rng, dim):
    """Origin, spacing, last cell, strides and coefficients of a grid of 4 x 5 (x 6) cells."""
    cells = np.array([4, 5, 6][:dim])
    shape = cells + 3
    strides = np.append(np.cumprod(shape[:0:-1])[::-1], 1).astype(np.int64)
    return rng.normal(size=dim), 0.5, cells - 1.0, strides, rng.normal(size=np.prod(shape))


def inside(rng, dim, lattice, n=M):
    origin, spacing, last, *_ = lattice
    return origin + spacing * rng.uniform(0.0, last + 1.0, (n, dim))


def spline_within(rng, dim):
    lattice = grid(rng, dim)
    R, t, z = rotations(rng, dim), rng.normal(size=dim), inside(rng, dim, lattice)
    return R, t, z.min(axis=0) - 1e-9, z.max(axis=0) + 1e-9, z @ R.T + t, *lattice


def spline_closer(rng, dim):
    *lattice, c = grid(rng, dim)
    R, t, z = rotations(rng, dim), rng.normal(size=dim), inside(rng, dim, lattice, 40)
    upper = z.max(axis=0) - 0.2
    return z @ R.T + t, R, t, z.min(axis=0) + 0.2, upper, 0.0, *lattice, np.full(len(c), -np.inf), c


def pieces(rng, dim, n=()):
    times = np.cumsum(rng.uniform(0.1, 1.0, 5))
    return times, rng.normal(size=(*n, 4, 4, 3)), rng.normal(size=(*n, 4, 3))


def sparse_modes(rng, dim):
    sets, of = [[0, 2, 3], [1, 2, 3, 4]], rng.integers(0, 2, M)
    counts = np.array([len(own) for own in sets])
    first = np.concatenate([[0], np.cumsum(dim**2 * counts[of])])
    start = np.concatenate([[0], np.cumsum(counts)])
    return SparseModes(rng.normal(size=first[-1]), first, of, start, np.concatenate(sets).astype(np.int64))


def sparse(rng, rows, columns):
    """Row starts, columns and entries, three a row."""
    at = np.sort(np.argsort(rng.random((rows, columns)), axis=1)[:, :3], axis=1)
    return (
        np.arange(0, 3 * rows + 1, 3, dtype=np.int32),
        at.ravel().astype(np.int32),
        rng.normal(size=3 * rows),
    )


def compliance(rng, dim):
    n, anchors, index = 6, 3, some(rng)
    _, columns, _ = sparse(
        rng, M, n * dim
    )  # the rows of one contact node have their entries in the same columns
    near = (
        np.arange(0, 3 * M * dim + 1, 3, dtype=np.int32),
        np.repeat(columns.reshape(M, 1, 3), dim, axis=1).ravel(),
        rng.normal(size=3 * M * dim).astype(np.float32),
    )
    operator = rng.normal(size=(anchors, dim, n * dim)).astype(np.float32)
    return index, rng.normal(size=(len(index), dim)), operator, sparse(rng, M, anchors), near


def neighbours(rng):
    """Row starts and columns: which of M contact nodes are near each, itself among them."""
    near = (rng.random((M, M)) < 0.6) | np.eye(M, dtype=bool)
    return np.concatenate([[0], np.cumsum(near.sum(axis=1))]), np.nonzero(near)[1]


def strains_of_contact_nodes(rng, dim):
    """Rows of N^T have entries at all components of two nodes each."""
    n, (_, _, operator, share, _) = 6, compliance(rng, dim)
    nodes = np.sort(np.argsort(rng.random((M, 2 * n))[:, :n], axis=1)[:, :2], axis=1)
    columns = (nodes[:, :, None] * dim + np.arange(dim)).reshape(M, 1, -1)
    near = (
        np.arange(0, 2 * dim * M * dim + 1, 2 * dim, dtype=np.int32),
        np.repeat(columns, dim, axis=1).ravel().astype(np.int32),
        rng.normal(size=2 * dim * M * dim).astype(np.float32),
    )
    cells = rng.integers(0, n, (M, 2, dim + 1)), rng.normal(size=(M, 2, dim + 1, dim))
    return *neighbours(rng), *cells, operator.reshape(-1, dim, n, dim), share, near


def strains_among(rng, dim):
    """M contact nodes, how many components they have, those near each, and their places among twice as many blocks."""
    starts, others = neighbours(rng)
    pairs = np.sort(rng.permutation(2 * len(others))[: len(others)])
    blocks = rng.normal(size=(2 * len(others), 2 * dim**2, dim)).astype(np.float32)
    return rng.integers(1, 2 * dim**2 + 1, M), starts, others, pairs, blocks


def cell_groups(rng, dim):
    """Cells, where each group's begin, columns, where each group's begin; and blocks in single precision."""
    felt = [np.array([0, 2]), np.array([1, 3, 4])]
    columns = [(own[:, None] * dim + np.arange(dim)).ravel() for own in felt]
    counts = np.array([3, M - 3])
    size = sum(len(own) * dim**2 * m for own, m in zip(columns, counts))
    layout = (
        rng.permutation(M),
        np.array([0, 3, M]),
        np.concatenate(columns),
        np.array([0, len(columns[0]), len(columns[0]) + len(columns[1])]),
    )
    return layout, np.array([2, 3]), rng.normal(size=size).astype(np.float32)


def group_of_cells(rng, dim):
    layout, _, blocks = cell_groups(rng, dim)
    return *layout, blocks


def turned_groups(rng, dim):
    layout, felt, blocks = cell_groups(rng, dim)
    return layout[1], felt, blocks, rotations(rng, dim, M).astype(np.float32)


def sparse_along(rng, dim):
    columns, along = np.array([0, 1, 4, 5]), rng.normal(size=(ROWS * dim, 6))
    along[rng.random(along.shape) < 0.7] = 0.0
    return rng.normal(size=(4, dim**2, M)).astype(np.float32), columns, along


def smooth_parts(rng, dim):
    one, other = ((rng.normal(size=M), rng.normal(size=(M, dim)), symmetric(rng, dim)) for _ in range(2))
    return *one, *other, 1.5


def penalty(rng, dim):
    return (
        rng.uniform(1, 2, M),
        rng.normal(size=M),
        rng.normal(size=(M, dim)),
        symmetric(rng, dim),
        rotations(rng, dim),
    )


def ball(rng, dim):
    lower, upper = -rng.uniform(0.5, 1, dim), rng.uniform(0.5, 1, dim)
    return rotations(rng, dim), rng.normal(size=dim), lower, upper, 2 * rng.normal(size=dim), 1.0


def free_spin(rng, dim):
    """Inertia, momentum, time step and spin of a body in 3D."""
    A = rng.normal(size=(3, 3))
    return np.eye(3) + 0.3 * A @ A.T, rng.normal(size=3), 0.3, rng.normal(size=3)


#: The arguments of every kernel, of a generator of random numbers and the dimension.
INPUTS = {
    "body.rotations": {
        "_exponential": lambda rng, dim: (rng.normal(size=spins(dim)),),
        "rotated_by": lambda rng, dim: (rotations(rng, dim, M), rng.normal(size=(M, spins(dim)))),
        "moved_frames": lambda rng, dim: (
            frames(rng, dim),
            rng.normal(size=(M, dim)),
            rng.normal(size=(M, dim + spins(dim))),
        ),
        "frame_tangents": lambda rng, dim: (frames(rng, dim), rng.normal(size=(M, dim)), generators(dim)),
        "frame_slopes": lambda rng, dim: (
            frames(rng, dim),
            rng.normal(size=(M, dim)),
            rng.normal(size=(M, dim + 1, dim)),
            generators(dim),
        ),
        "_polar_2d": lambda rng, dim: (near_identity(rng, dim), np.zeros((M, dim, dim))),
        "_polar_3d": lambda rng, dim: (near_identity(rng, dim), np.zeros((M, dim, dim))),
    },
    "colliders.combine": {"_smooth_minimum": smooth_parts},
    "colliders.cone_kernels": {"values": lambda rng, dim: (rng.normal(size=(M, dim)), cones(rng, dim), 0.2)},
    "colliders.path": {
        "_along": lambda rng, dim: (*pieces(rng, dim), rng.uniform(0, 3)),
        "_all_along": lambda rng, dim: (
            *pieces(rng, dim, (M,)),
            rotations(rng, dim, 5 * M).reshape(M, 5, 3, 3),
            rng.uniform(0, 3),
        ),
    },
    "colliders.pose_kernels": {
        "rotated": lambda rng, dim: (rng.normal(size=(M, dim)), symmetric(rng, dim), rotations(rng, dim))
    },
    "colliders.sampled.polygon": {
        # Sides may cross: the parity of crossings is defined all the same.
        "polygon_distance": lambda rng, dim: (rng.normal(size=(50, 2)), rng.normal(size=(M, 2)))
    },
    "colliders.sampled.spline_kernels": {
        "values": lambda rng, dim: (inside(rng, dim, lattice := grid(rng, dim)), *lattice, np.full(M, 9.0)),
        "gradients": lambda rng, dim: (
            inside(rng, dim, lattice := grid(rng, dim)),
            *lattice,
            np.full(M, 9.0),
            np.full((M, dim), 9.0),
        ),
        "derivatives": lambda rng, dim: (
            inside(rng, dim, lattice := grid(rng, dim)),
            *lattice,
            np.full(M, 9.0),
            np.full((M, dim), 9.0),
            np.full((M, dim, dim), 9.0),
        ),
        "derivatives_within": spline_within,
        "closer": spline_closer,
    },
    "colliders.surface_mesh.sweep_kernels": {
        "_squared_distance": lambda rng, dim: (rng.normal(size=(3, 3)), *rng.normal(size=3))
    },
    "contact.dents.dent_strain_kernels": {
        "strain_blocks": strains_of_contact_nodes,
        "near_among": lambda rng, dim: (np.array([0, 2, 3]), np.array([1, 2]), *neighbours(rng)),
        "strains_by": lambda rng, dim: (*strains_among(rng, dim), rng.normal(size=(M, dim, 4))),
        "forces_by": lambda rng, dim: (M, *strains_among(rng, dim), rng.normal(size=(M, 2 * dim**2, 3))),
    },
    "contact.piercing_kernels": {
        "bounds": lambda rng, dim: (rng.normal(size=(M, dim)),),
        "in_box": lambda rng, dim: (rng.normal(size=(M, dim)), np.full(dim, -0.8), np.full(dim, 0.9)),
        "farther_from_all": lambda rng, dim: (rng.normal(size=(9, dim)), rng.normal(size=(M, dim)), 0.7),
        "nearest_points": lambda rng, dim: (
            2.0 * rng.normal(size=(9, dim)),
            y := rng.normal(size=(M, dim)),
            np.argsort(y[:, 1]),
            1,
        ),
    },
    "contact.stretched_gaps": {
        "longest_edges": lambda rng, dim: (rng.normal(size=(M, dim)), rng.integers(0, M, (9, dim))),
    },
    "contact.carriers.rotation_kernels": {
        "stretches": lambda rng, dim: (rotations(rng, dim, M), near_identity(rng, dim), 0.1),
        "pulled_back": lambda rng, dim: (
            rotations(rng, dim, M),
            rng.normal(size=(M, *2 * [1 if dim == 2 else 3])),
            rng.normal(size=(M, dim, dim)),
        ),
    },
    "contact.point_kernels": {
        "penalty": penalty,
        "friction": lambda rng, dim: (
            rng.normal(size=(M, dim)),
            rng.normal(size=(M, dim)),
            normals(rng, dim),
            rng.uniform(1, 2, M),
            1.0,
        ),
    },
    "dynamics.terms.cell_group_blocks": {
        "_times": lambda rng, dim: (*group_of_cells(rng, dim), rng.normal(size=ROWS * dim), dim),
        "_gathered": lambda rng, dim: (*group_of_cells(rng, dim), rng.normal(size=(M, dim, dim)), ROWS * dim),
        "_seen": lambda rng, dim: (
            *group_of_cells(rng, dim),
            rotations(rng, dim, M),
            rng.normal(size=(ROWS, dim)),
        ),
        "_to_world": turned_groups,
        "_along": sparse_along,
        "_weighted": lambda rng, dim: (
            rng.normal(size=(dim**2, dim**2, M)).astype(np.float32),
            rng.normal(size=(6, dim**2, M)).astype(np.float32),
        ),
        "_add": lambda rng, dim: (
            rng.normal(size=(9, 9)),
            rng.permutation(9)[:4],
            rng.normal(size=(4, 4)).astype(np.float32),
        ),
    },
    "dynamics.terms.corner_gradients": {
        "_moved_corners": lambda rng, dim: (
            rng.normal(size=(M, dim**2, 5)).astype(np.float32),
            rng.normal(size=(9, dim, 5)).astype(np.float32),
            rng.integers(9, size=(M, dim + 1)),
            rng.normal(size=(M, dim + 1, dim)).astype(np.float32),
        ),
        "_stressed": lambda rng, dim: (
            rng.normal(size=(M, dim**2, dim**2)).astype(np.float32),
            rng.normal(size=(M, dim**2, 5)).astype(np.float32),
        ),
    },
    "elasticity.invariants": {
        name: lambda rng, dim: (near_identity(rng, dim),)
        for name in ("first_invariant", "determinant", "cofactor")
    },
    "elasticity.materials.linear": {
        "_energy_and_stress": lambda rng, dim: (near_identity(rng, dim), *rng.uniform(1, 2, (2, M))),
        "_tangent": lambda rng, dim: (dim, *rng.uniform(1, 2, (2, M))),
    },
    # Some turned inside out, where the logarithm is continued.
    "elasticity.materials.invertible_neo_hookean": {
        "_energy_and_stress": lambda rng, dim: strained(
            rng, np.eye(dim) + 0.6 * rng.normal(size=(M, dim, dim))
        )
    },
    "elasticity.materials.stable_neo_hookean": {
        "_energy_and_stress": lambda rng, dim: strained(rng, near_identity(rng, dim))
    },
    "elasticity.tangent_kernel": {
        "isotropic_tangent": lambda rng, dim: (
            near_identity(rng, dim),
            near_identity(rng, dim),
            *rng.normal(size=(4, M)),
        ),
    },
    "linalg.means": {
        "shared": lambda rng, dim: (
            rng.normal(size=(5, dim)),
            rng.integers(0, M, (5, dim)),
            rng.uniform(size=(5, dim)),
            M,
        ),
        "bounded_means": lambda rng, dim: (
            rng.normal(size=(M, dim)),
            rng.uniform(size=M),
            rng.integers(0, M, (5, dim)),
            rng.uniform(size=(5, dim)),
        ),
        "blocks_on_nodes": lambda rng, dim: (
            rng.normal(size=(5, dim, dim)),
            rng.integers(0, M, (5, dim)),
            rng.uniform(size=(5, dim)),
            M,
        ),
        "numbered": lambda rng, dim: (rng.integers(0, M, (3, dim)), M),
        "means": lambda rng, dim: (
            rng.normal(size=(M, dim, ROWS)[:dim]),
            rng.integers(0, M, (5, dim)),
            rng.uniform(size=(5, dim)),
        ),
    },
    "learned.internal.equilibrium.mode_kernels": {
        "summed": lambda rng, dim: (
            rng.normal(size=(M * dim, 5)).astype(np.float32),
            rng.normal(size=5),
        ),
        "along_modes": lambda rng, dim: (
            rng.normal(size=(M * dim, 5)).astype(np.float32),
            rng.normal(size=M * dim),
        ),
    },
    "linalg.row_products": {
        "placed_some": lambda rng, dim: (rng.normal(size=(M, ROWS)), rng.normal(size=(ROWS, dim)), some(rng)),
        "placed": lambda rng, dim: (rng.normal(size=(M, ROWS)), rng.normal(size=(ROWS, dim))),
        "deformed_some": lambda rng, dim: (
            rng.normal(size=(M, dim, ROWS)),
            rng.normal(size=(ROWS, dim)),
            some(rng),
        ),
        "deformed": lambda rng, dim: (rng.normal(size=(M, dim, ROWS)), rng.normal(size=(ROWS, dim))),
    },
    "linalg.sparse_directions": {
        "times_directions": lambda rng, dim: (
            rng.normal(size=(4, ROWS)),
            rng.normal(size=(ROWS, 6)) * (rng.random((ROWS, 6)) < 0.4),
        ),
        "between_directions": lambda rng, dim: (
            rng.normal(size=(ROWS, ROWS)),
            rng.normal(size=(ROWS, 6)) * (rng.random((ROWS, 6)) < 0.4),
        ),
    },
    "mesh.simplex_kernels": {
        "bounding_balls": lambda rng, dim: (rng.normal(size=(9, dim)), rng.integers(9, size=(M, dim + 1)))
    },
    "touch.raster_kernels": {
        "seen": lambda rng, dim: (
            rng.uniform(-1, 7, size=(12, 2)),
            rng.normal(size=12),
            rng.permutation(12).reshape(4, 3).astype(np.int64),
            5,
            6,
        )
    },
    "mechanics.static_condensation_kernels": {
        "displacement": lambda rng, dim: (
            sparse_modes(rng, dim),
            rng.normal(size=(M, dim, dim)),
            some(rng),
            *rng.normal(size=(2, ROWS, dim)),
            rng.normal(size=dim),
            rotations(rng, dim, M),
        ),
        "derivative": lambda rng, dim: (
            sparse_modes(rng, dim),
            some(rng),
            *rng.normal(size=(2, ROWS)),
            rotations(rng, dim, M),
        ),
        "pulled_back": lambda rng, dim: (
            sparse_modes(rng, dim),
            some(rng),
            *rng.normal(size=(2, ROWS)),
            rotations(rng, dim, M),
            rng.normal(size=(4, dim)),
        ),
    },
    "mechanics.compliance.surface_compliance_kernels": {
        "apply": compliance,
        "gathered": lambda rng, dim: (rng.normal(size=(M, M, dim, dim)).astype(np.float32), some(rng)),
        "submatrix": lambda rng, dim: (symmetric_matrix(rng, M * dim), some(rng), dim),
        "displacement": lambda rng, dim: (
            rng.normal(size=(M, M, dim, dim)).astype(np.float32),
            some(rng),
            some(rng),
            rng.normal(size=(4, dim)),
        ),
        "displacement_of_many": lambda rng, dim: (
            rng.normal(size=(M, M, dim, dim)).astype(np.float32),
            np.arange(M),
            some(rng),
            rng.normal(size=(4, dim)),
        ),
        "copy_pairs": lambda rng, dim: (
            symmetric_pairs(rng, dim),
            rng.permutation(M)[:4],
            2,
            rng.normal(size=(5, 5, dim, dim)).astype(np.float32),
        ),
    },
    "rigid.free_rotation_kernels": {
        "midpoint_equation": free_spin,
        "middle_spin": lambda rng, dim: free_spin(rng, dim)[:3],
    },
    "rigid.kernels": {
        "point_motion": lambda rng, dim: (rng.normal(size=(M, dim)),),
        "own_curvature": lambda rng, dim: tuple(rng.normal(size=(2, M, dim))),
        "own_body_derivatives": lambda rng, dim: (*rng.normal(size=(2, M, dim)), symmetric(rng, dim)),
        "touched_body_derivatives": lambda rng, dim: (*rng.normal(size=(2, M, dim)), symmetric(rng, dim)),
        "between": lambda rng, dim: (rng.normal(size=(M, dim)), rng.normal(size=(M, dim, dim + spins(dim)))),
        "ball_meets": ball,
    },
}
CASES = {
    f"softprint.runtime.{module}.{name}": make
    for module, kernels in INPUTS.items()
    for name, make in kernels.items()
}


def copied(value):
    if isinstance(value, np.ndarray):
        return np.ascontiguousarray(value).copy()
    if isinstance(value, SparseModes):
        return SparseModes(*map(copied, value))
    return tuple(map(copied, value)) if isinstance(value, tuple) else value


def as_list(result):
    if result is None:
        return []
    return list(result) if isinstance(result, tuple) else [result]


@pytest.mark.parametrize("name", CASES)
def test_kernel_is_its_reference(name, dim):
    if (dim == 2 and name in ONLY_3D) or (dim == 3 and name in ONLY_2D):
        return
    kernel, reference = REFERENCES[name]
    for seed in range(3):
        arguments = copied(CASES[name](np.random.default_rng(seed), dim))
        before = copied(arguments)
        expected = as_list(reference(*copied(arguments)))
        found = as_list(kernel(*arguments))
        # What a kernel writes into its arguments comes after what it returns.
        found += [
            after
            for after, old in zip(arguments, before)
            if isinstance(after, np.ndarray) and not np.array_equal(after, old)
        ]
        assert len(found) == len(expected)
        for mine, theirs in zip(found, expected):
            single = any(isinstance(a, np.ndarray) and a.dtype == np.float32 for a in (*arguments, mine))
            scale = max(float(np.max(np.abs(theirs), initial=0.0)), 1e-3)
            assert np.shape(mine) == np.shape(theirs)
            np.testing.assert_allclose(mine, theirs, rtol=0, atol=(SINGLE if single else DOUBLE) * scale)


def test_every_reference_is_tested():
    of_these_files = {name for name in REFERENCES if name.rpartition(".")[0] in KERNEL_FILES}
    assert of_these_files == set(CASES)
