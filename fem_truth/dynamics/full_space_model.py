"""The model `full` of `softprint simulate`: a scene simulated in full space (entry point group
``softprint.models``)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from softprint.fem_truth.dynamics.full_space_simulator import FullSpaceSimulator
from softprint.fem_truth.dynamics.full_space_state import FullSpaceState
from softprint.runtime.arrays import Array, IntArray
from softprint.runtime.body import ReducedBody
from softprint.runtime.dynamics.placed_collider import PlacedCollider
from softprint.runtime.dynamics.state import StepResult
from softprint.runtime.scenes.scene import SceneParts, scene_parts

if TYPE_CHECKING:
    from softprint.fem_truth.elasticity.full_space_elasticity import FullSpaceElasticity
    from softprint.fem_truth.energy.barrier_contact import BarrierLaw
    from softprint.runtime.experiment import Experiment, SceneSpec


class FullSpaceModel:
    """A `runtime.scenes.playing.SceneModel` in full space."""

    def __init__(self, simulator: FullSpaceSimulator, held: bool) -> None:
        self._simulator = simulator
        self._held = held

    @property
    def colliders(self) -> Sequence[PlacedCollider]:
        """The colliders of the scene, in its order."""
        return self._simulator.colliders

    def start(self) -> StepResult[FullSpaceState]:
        """Frame 0: static equilibrium, or the rest state if nothing fixes the body."""
        return self._simulator.settle() if self._held else self._simulator.at_rest()

    def step(self, state: FullSpaceState) -> StepResult[FullSpaceState]:
        """One step of `FullSpaceSimulator.step`."""
        return self._simulator.step(state)

    def positions(self, state: FullSpaceState) -> Array:
        """(n_nodes, dim) [m]."""
        return state.x

    def surface_positions(self, state: FullSpaceState) -> Array:
        """(s, dim) [m] the surface nodes."""
        return state.x[self._simulator.body.mesh.surface_nodes]

    def follow(self, nodes: IntArray) -> Callable[[FullSpaceState], Array]:
        """A function from a state to the positions (n, dim) [m] of some nodes (n,) of the mesh."""
        return lambda state: state.x[nodes]

    def rows(self, state: FullSpaceState) -> Array:
        """(n_rows, dim) handle rows of the nearest reduced state; its frames are affine where a barrier lets the body
        strain their regions."""
        return self._simulator.body.project(state.x)


def full_space_model(
    experiment: Experiment, body: ReducedBody, scene: SceneSpec, out: Path
) -> FullSpaceModel:
    """A `runtime.scenes.playing.ModelFactory`; ``out`` is not needed."""
    parts = scene_parts(experiment, scene)
    barrier = None
    if experiment.contact.model == "barrier":
        from softprint.fem_truth.energy.barrier_contact import BarrierLaw  # needs the IPC Toolkit

        young = float(np.mean(body.material.young))
        barrier = BarrierLaw.of(experiment.contact.distance, body.mesh, young)
    return FullSpaceModel(scene_simulator(parts, body, barrier=barrier), parts.held)


def scene_simulator(
    parts: SceneParts,
    body: ReducedBody,
    elasticity: FullSpaceElasticity | None = None,
    barrier: BarrierLaw | None = None,
) -> FullSpaceSimulator:
    """The simulator of a scene; elasticity: that of the body, if it is there already; barrier: see
    `FullSpaceSimulator`."""
    return FullSpaceSimulator(
        body,
        parts.colliders,
        contact=parts.contact,
        friction=parts.friction,
        gravity=parts.gravity,
        springs=parts.springs,
        kinematic=parts.kinematic,
        settings=parts.settings,
        elasticity=elasticity,
        barrier=barrier,
    )


MODEL = full_space_model
