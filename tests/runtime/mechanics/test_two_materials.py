"""Bodies of two materials: stripes in series against their analytic stiffness, reduced and condensed."""

from __future__ import annotations

import numpy as np
import pytest

from softprint.runtime.body import ReducedBody, assemble_body, frame_in_box, place_handles
from softprint.runtime.body.build import material_of_cells
from softprint.runtime.colliders import KeyframedPath
from softprint.runtime.contact import PenaltyContact
from softprint.runtime.dynamics import KinematicHandle, Simulator
from softprint.runtime.experiment.schema.body import MaterialRegionSpec, MaterialSpec
from softprint.runtime.mechanics.body_mechanics import BodyMechanics, compute_mechanics
from softprint.runtime.mesh import box_mesh

STIFF, SOFT = 4e5, 2e4  # Pa
LENGTH, SIDE = 0.08, 0.02  # m, of the stripes between the frames, and across
STRAIN = 1e-4


@pytest.fixture
def bar(dim) -> ReducedBody:
    """Four stripes along x, of 20 mm each, stiff and soft in turn, between frames of one layer of cells. Without
    lateral contraction, each stripe is strained evenly, and two linear cells would do."""
    layer = 0.005
    upper = [LENGTH + layer, *([SIDE] * (dim - 1))]
    mesh = box_mesh([-layer, *([0.0] * (dim - 1))], upper, [18, *([3] * (dim - 1))])
    low, high = [-1.0] * dim, [1.0] * dim
    ends = [
        frame_in_box(mesh, "left", [low, [1e-9, *high[1:]]]),
        frame_in_box(mesh, "right", [[LENGTH - 1e-9, *low[1:]], high]),
    ]
    regions = tuple(
        MaterialRegionSpec(
            box=((0.02 * k, *low[1:]), (0.02 * (k + 1), *high[1:])), young=SOFT if k % 2 else STIFF
        )
        for k in range(4)
    )
    spec = MaterialSpec(young=STIFF, poisson=0.0, regions=regions)
    material, density = material_of_cells(mesh, spec)
    return assemble_body(mesh, place_handles(mesh, 0, ends), material, density)


def pulled(body: ReducedBody, mechanics: BodyMechanics | None = None) -> float:
    """Young's modulus [Pa] of the bar, from its energy when its ends are pulled apart."""
    far = np.zeros((1, body.dim))
    far[0, 0] = STRAIN * LENGTH
    held = (KinematicHandle("left"), KinematicHandle("right", KeyframedPath([0.0], far)))
    simulator = Simulator(body, contact=PenaltyContact(1e9), kinematic=held, mechanics=mechanics)
    energy = simulator.settle().energies["elastic"]
    return 2.0 * energy / (STRAIN**2 * LENGTH * SIDE ** (body.dim - 1))


def test_stripes_in_series_are_as_stiff_as_the_formula(bar):
    """Static condensation finds the deformation of stripes in series, 2 E1 E2 / (E1 + E2), which the subspace of two
    frames cannot represent: it is at least as stiff as stripes side by side, (E1 + E2) / 2."""
    series, parallel = 2.0 * STIFF * SOFT / (STIFF + SOFT), 0.5 * (STIFF + SOFT)
    condensation = compute_mechanics(bar, 20, True).condensation
    # The modes are single precision; of the strain 1e-4, the energy of higher order is as large.
    assert pulled(bar, BodyMechanics(None, condensation)) == pytest.approx(series, rel=1e-3)
    assert pulled(bar) > 0.99 * parallel


def test_each_cell_has_the_material_of_its_stripe(bar):
    centroids = bar.mesh.cell_centroids[:, 0]
    soft = (np.floor(centroids / 0.02).astype(int) % 2 == 1) & (centroids > 0) & (centroids < LENGTH)
    np.testing.assert_array_equal(np.asarray(bar.material.young), np.where(soft, SOFT, STIFF))
