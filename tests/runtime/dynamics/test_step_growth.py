"""A reduced step does not get dearer as the mesh gets finer: nothing in it has the length of the mesh.

A tapered block with a cone pressed into its top, with friction, on two meshes of which the finer has 16 times as many
tetrahedra, with the same handles. A part of a step that went over all cells or nodes would cost 16 times as much, one
that went over the nodes of the surface 6 times.
"""

from __future__ import annotations

import time
import tracemalloc
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest

from softprint.runtime.body import ReducedBody, assemble_body, frame_in_box, place_handles
from softprint.runtime.colliders import Cone, KeyframedPath
from softprint.runtime.contact import CoulombFriction, PenaltyContact
from softprint.runtime.dynamics import (
    DynamicsSettings,
    KinematicHandle,
    NewtonSettings,
    PlacedCollider,
    Simulator,
)
from softprint.runtime.elasticity import make_material
from softprint.runtime.mechanics.body_mechanics import BodyMechanics, compute_mechanics
from softprint.runtime.mesh import Mesh, box_mesh

COARSE, FINE = (7, 7, 5), (18, 18, 12)
HEIGHT = 0.06  # m
STEPS = 25
# Two Newton iterations in every step, converged or not, so that steps of both meshes do the same.
TWICE = DynamicsSettings(1 / 60, NewtonSettings(max_iterations=2, tolerance=1e-12))


@dataclass(frozen=True)
class Cost:
    """Of a step in contact: bytes of Python's and numpy's allocations at their peak, and CPU seconds of the fastest of
    all, which other programs disturb least."""

    memory: int
    seconds: float
    cells: int
    cubature: int


def tapered_block(divisions: tuple[int, int, int]) -> ReducedBody:
    """0.1 m wide at the base, 0.076 m at the top; 12 points and the base as a frame."""
    mesh = box_mesh([-0.05, -0.05, 0.0], [0.05, 0.05, HEIGHT], divisions)
    narrowing = 1.0 - 0.24 * mesh.points[:, 2:] / HEIGHT
    mesh = Mesh(mesh.points * np.hstack([narrowing, narrowing, np.ones_like(narrowing)]), mesh.cells)
    base = frame_in_box(mesh, "base", [[-1.0, -1.0, -1.0], [1.0, 1.0, 0.0125]])
    handles = place_handles(mesh, 12, [base])
    return assemble_body(mesh, handles, make_material("stable_neo_hookean", 2e4, 0.4), 1000.0)


def cost_of_a_step(body: ReducedBody, mechanics: BodyMechanics | None) -> Cost:
    cone = Cone([0.0, 0.0, 0.0], [0.0, 0.0, 0.08], 0.008, 0.03, "cone")
    top = HEIGHT + 0.008
    path = KeyframedPath(
        [0.0, 0.2, 0.2 + STEPS / 60], [[0, 0, top], [0, 0, top - 0.01], [0.01, 0, top - 0.01]]
    )
    simulator = Simulator(
        body,
        [PlacedCollider("cone", cone, path)],
        contact=PenaltyContact(1e10),
        mechanics=mechanics,
        friction=CoulombFriction(0.3),
        gravity=[0.0, 0.0, -9.81],
        kinematic=[KinematicHandle("base")],
        settings=TWICE,
    )
    state = simulator.settle().state
    for _ in range(12):  # into contact
        state = simulator.step(state).state
    seconds = []
    for _ in range(STEPS):
        began = time.process_time()
        result = simulator.step(state)
        seconds.append(time.process_time() - began)
        state = result.state
    assert result.penetration > 0
    tracemalloc.start()
    try:
        before, _ = tracemalloc.get_traced_memory()
        simulator.step(state)
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    return Cost(peak - before, min(seconds), body.mesh.n_cells, len(body.cubature.cells))


def no_mechanics(body: ReducedBody) -> None:
    """The bare reduced model."""


def mechanics(body: ReducedBody) -> BodyMechanics:
    """Condensed contact at 150 nodes."""
    return compute_mechanics(body, 150, condensation=True)


@pytest.mark.parametrize("of", [no_mechanics, mechanics], ids=["bare", "condensed contact"])
def test_a_step_does_not_grow_with_the_mesh(of: Callable[[ReducedBody], BodyMechanics | None]):
    coarse, fine = (cost_of_a_step(body, of(body)) for body in map(tapered_block, (COARSE, FINE)))
    assert fine.cells > 15 * coarse.cells
    assert fine.cubature <= 1.25 * coarse.cubature
    # Measured: 1.07 to 2.07 (the bare subspace has contact at all points under the cone, which become more), and 1.00
    # to 1.03. Work along the surface would make it 6, along cells or nodes 16.
    assert fine.memory < 2.5 * coarse.memory
    assert fine.seconds < 2.5 * coarse.seconds
