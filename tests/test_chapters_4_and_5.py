"""The scripts of chapters 4 and 5: what they compute beside the models that they compare."""

from __future__ import annotations

import numpy as np
import pytest

from reproduction.disentangled import mappings
from reproduction.floater_fall import passage
from reproduction.superposition import paths_at, together
from softprint.runtime.arrays import Array
from softprint.runtime.body import ReducedBody, assemble_body, frame_in_box, place_handles
from softprint.runtime.colliders import Sphere
from softprint.runtime.elasticity.materials import make_material
from softprint.runtime.learned.force.correction import ForceCorrection
from softprint.runtime.learned.force.model import ForceModel, ForceModelOptions
from softprint.runtime.mechanics.body_mechanics import compute_mechanics
from softprint.runtime.mesh import box_mesh

RADIUS, DEPTH = 0.01, 1e-4  # m; so shallow that the response is nearly linear


@pytest.fixture(scope="module")
def layer() -> ReducedBody:
    """A soft layer of 0.4 x 0.02 m on a rigid slab."""
    mesh = box_mesh([-0.2, 0.0], [0.2, 0.02], [160, 8])
    handles = place_handles(mesh, 8, [frame_in_box(mesh, "base", [[-1.0, -1.0], [1.0, 0.003]])])
    return assemble_body(mesh, handles, make_material("stable_neo_hookean", 2e4, 0.4), 1000.0)


@pytest.fixture(scope="module")
def mechanics(layer) -> ForceCorrection:
    """Linear mechanics of the layer, as a correction."""
    options = ForceModelOptions((4,), "silu", 5e-4, 3e-3, 1e11)
    model = ForceModel(options, 2, layer.n_rows)
    own = compute_mechanics(layer, 400, condensation=True)
    return ForceCorrection("mechanics", model, layer, Sphere(RADIUS, 2, name="ball"), own)


def defect(body: ReducedBody, mechanics: ForceCorrection, apart: float) -> float:
    """How far the sum of two contacts alone is from both together, relative."""
    paths = paths_at(body, body.mesh.points, RADIUS, DEPTH, [-0.5 * apart, 0.5 * apart])
    both: Array = together(body, mechanics, paths)
    added = sum(together(body, mechanics, [path]) for path in paths)
    return float(np.linalg.norm(added - both) / np.linalg.norm(both))


def test_superposition_is_exact_for_far_colliders_in_the_linear_limit(layer, mechanics):
    """What a contact adds decays within some thicknesses of a layer on a rigid slab."""
    # 1e-3: contact forces of a solve balance to about that of their depth.
    assert defect(layer, mechanics, 0.28) < 1e-3
    # Side by side each pushes up the surface that the other touches.
    assert defect(layer, mechanics, 0.025) > 0.01


def test_all_ways_to_learn_the_same_displacement_give_it_back(layer):
    """F^-1 (x - U q), x - U q, and x."""
    rng = np.random.default_rng(0)
    rows = layer.handles.retract(
        layer.rest_rows, 1e-3 * layer.handles.units(0.05) * rng.normal(size=layer.handles.n_dofs)
    )
    u = 1e-3 * rng.normal(size=(layer.n_nodes, 2))
    learned = {name: way.learned_from(rows, u) for name, way in mappings(layer).items()}
    assert np.abs(learned["local"] - u).max() > 1e-5  # m: they differ
    for name, way in mappings(layer).items():
        np.testing.assert_allclose(way.displacement(rows, learned[name]), u, atol=1e-14)


def test_a_passage_is_found_between_two_frames():
    times = np.array([0.0, 0.1, 0.2, 0.3])
    assert passage(times, np.array([0.02, 0.01, -0.01, -0.05])) == pytest.approx(0.15)
    assert passage(times, np.array([0.02, 0.01, 0.005, 0.001])) is None
    assert passage(times, np.array([-0.02, 0.01, 0.005, 0.001])) == 0.0
