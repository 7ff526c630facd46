"""Every registered kind of collider: derivatives, inside and outside, and the mass of a free body.

The tests walk over the examples of every table in `KINDS`; a new kind is tested by being there. What is particular to
one kind (closed forms, refusals) is tested in `test_colliders.py` and beside the module of the kind.
"""

from pathlib import Path

import numpy as np
import pytest
import trimesh
from pydantic import TypeAdapter
from scipy.stats import qmc

from softprint.runtime.colliders.build import build_collider
from softprint.runtime.colliders.kinds.registry import KINDS, ColliderSpec, shape_names
from softprint.runtime.colliders.level_set import collider_surface
from softprint.runtime.errors import SoftprintError
from softprint.runtime.experiment import Experiment
from softprint.runtime.experiment.describe import described_keys
from softprint.runtime.rigid import mass_properties

STEP = 1e-6  # [m] of central differences, on solids of one metre: truncation 1e-12 / R^2, round-off 1e-10
EXAMPLES = [
    pytest.param(kind, table, id=f"{table['shape']}{number}")
    for kind in KINDS
    for number, table in enumerate(kind.examples)
]
every_example = pytest.mark.parametrize(("kind", "table"), EXAMPLES)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where tables find their files: `block.stl`, in millimetres."""
    folder = tmp_path_factory.mktemp("tables")
    trimesh.creation.box(extents=[600.0, 800.0, 700.0]).export(folder / "block.stl")
    return folder


def collider_of(table, folder):
    return build_collider(TypeAdapter(ColliderSpec).validate_python(dict(table)), folder)


def points(collider, count=1500):
    """All around it: its bounds, and half as much again on every side; where it has none, a metre about the origin."""
    bounded = np.isfinite(collider.upper).all()
    middle = 0.5 * (collider.lower + collider.upper) if bounded else np.zeros(collider.dim)
    half = 0.5 * (collider.upper - collider.lower) if bounded else np.ones(collider.dim)
    return middle + 2.0 * half * np.random.default_rng(5).uniform(-1.0, 1.0, (count, collider.dim))


def surface_of(collider):
    """Some points on it."""
    if np.isfinite(collider.upper).all():
        vertices, _ = collider_surface(collider, cells=24)
    else:
        vertices = points(collider)
    for _ in range(3):  # Newton's method along the gradient
        d = collider.sdf_derivatives(vertices)
        vertices = vertices - (d.value / np.einsum("ni,ni->n", d.gradient, d.gradient))[:, None] * d.gradient
    return vertices


@pytest.mark.parametrize("kind", KINDS)
def test_every_name_of_a_kind_has_an_example_and_can_stand_in_an_experiment(kind):
    listed = [line for key, line, _ in described_keys(Experiment) if key == "colliders[].shape"]
    assert {table["shape"] for table in kind.examples} == set(shape_names(kind))
    for shape in shape_names(kind):
        assert sum(f'"{shape}"' in line for line in listed) == 1
    for table in kind.examples:
        assert type(TypeAdapter(ColliderSpec).validate_python(dict(table))) is kind


@every_example
def test_a_collider_has_the_name_of_its_table_and_is_placed(kind, table, folder):
    plain = collider_of(table, folder)
    assert plain.name == table["shape"]
    offset = np.arange(1.0, plain.dim + 1.0)
    moved = collider_of({**table, "name": "thing", "position": list(offset)}, folder)
    assert moved.name == "thing"
    z = points(plain, 50)
    np.testing.assert_allclose(moved.sdf(z + offset), plain.sdf(z), atol=1e-12)  # round-off


@every_example
def test_gradient_and_hessian_are_derivatives_of_the_distance(kind, table, folder):
    collider = collider_of(table, folder)
    z = points(collider)
    d = collider.sdf_derivatives(z)
    np.testing.assert_allclose(collider.sdf(z), d.value, atol=1e-12)  # the same sums in another order
    gradient, hessian = np.empty_like(d.gradient), np.empty_like(d.hessian)
    for j, step in enumerate(STEP * np.eye(collider.dim)):
        gradient[:, j] = (collider.sdf(z + step) - collider.sdf(z - step)) / (2 * STEP)
        forward, backward = collider.sdf_derivatives(z + step), collider.sdf_derivatives(z - step)
        hessian[:, :, j] = (forward.gradient - backward.gradient) / (2 * STEP)
    # A few points straddle a jump of curvature, or lie beside a medial axis.
    error = np.abs(d.gradient - gradient).max(axis=1)
    assert np.quantile(error, 0.99) < 1e-8
    error = np.abs(d.hessian - hessian).max(axis=(1, 2)) / (1 + np.abs(d.hessian).max(axis=(1, 2)))
    assert np.quantile(error, 0.99) < 1e-6
    np.testing.assert_allclose(d.hessian, d.hessian.transpose(0, 2, 1), atol=1e-9)


@every_example
def test_it_is_negative_inside_positive_outside_and_no_steeper_than_a_distance(kind, table, folder):
    collider = collider_of(table, folder)
    on = surface_of(collider)
    normal = collider.sdf_derivatives(on).gradient
    np.testing.assert_allclose(collider.sdf(on), 0.0, atol=1e-6)
    # 1 mm off the surface of a solid of a metre; blends are flatter where the normals of their parts disagree.
    for side in (-1e-3, 1e-3):
        value = collider.sdf(on + side * normal)
        assert (np.sign(value) == np.sign(side)).all()
    z = points(collider)
    value = collider.sdf(z)
    inside = z[value < 0]
    assert len(inside) > 10
    assert ((inside >= collider.lower) & (inside <= collider.upper)).all()
    apart = np.linalg.norm(z[1:] - z[:-1], axis=1)
    assert (np.abs(np.diff(value)) < 1.01 * apart).all()  # grids of splines: as `grid.py` says


@every_example
def test_the_mass_of_a_free_body_is_that_of_its_inside(kind, table, folder):
    """Against counting: which of 2^16 well-spread points of the bounds are inside."""
    collider = collider_of(table, folder)
    if not np.isfinite(collider.upper).all():
        with pytest.raises(SoftprintError, match="no bounds"):
            mass_properties(collider)
        return
    extent = collider.upper - collider.lower
    spread = collider.lower + extent * qmc.Sobol(collider.dim, scramble=False).random_base2(16)
    inside = spread[collider.sdf(spread) < 0]
    found, volume = mass_properties(collider, density=2.0), extent.prod() * len(inside) / len(spread)
    # Counting is good to some 1e-3: points near the surface, n^(-(dim + 1) / (2 dim)) of all.
    assert found.mass == pytest.approx(2.0 * volume, rel=5e-3)
    np.testing.assert_allclose(found.centre, inside.mean(axis=0), atol=2e-3)
    second = 2.0 * volume * np.cov(inside.T, bias=True)
    np.testing.assert_allclose(found.second_moment, second, atol=5e-3 * np.abs(second).max())
