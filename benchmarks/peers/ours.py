"""Full space and our reduced models as engines."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.peers.engine import Setting, steps_of
from benchmarks.peers.scene import FRAME, Scene
from softprint.fem_truth.dynamics.full_space_simulator import FullSpaceSimulator
from softprint.runtime.arrays import Array
from softprint.runtime.contact import PenaltyContact
from softprint.runtime.dynamics import DynamicsSettings, KinematicHandle, PlacedCollider, Simulator
from softprint.runtime.experiment.schema.training import ModelSpec
from softprint.runtime.learned.correction import Correction, mechanics_of
from softprint.runtime.learned.correction_file import load_correction
from softprint.runtime.learned.force.correction import ForceCorrection
from softprint.runtime.learned.force.entry import options
from softprint.runtime.learned.force.model import ForceModel
from softprint.runtime.mechanics.body_mechanics import BodyMechanics
from softprint.runtime.optimise import NewtonSettings

LAW = "stable neo-Hookean"
# Of the reference, which is also solved more closely; N/m^4.
REFERENCE_STEP, REFERENCE_STIFFNESS, REFERENCE_REFINEMENT = FRAME / 4.0, 3e13, 2
_REFERENCE_ITERATIONS, _REFERENCE_TOLERANCE = 100, 1e-5
STEPS = (FRAME, FRAME / 2.0, FRAME / 4.0)


class SoftprintEngine:
    """A simulator of this project: full space or reduced."""

    def __init__(self, scene: Scene, simulator: Any, step: float) -> None:
        self._name, self._simulator, self._step = scene.collider.name, simulator, step
        self._state = simulator.rest_state()
        self._force = np.zeros(3)

    def settle(self, x: Array) -> None:
        self._state = self._simulator.settle().state

    def advance(self, begin: float, end: float) -> None:
        for _ in range(steps_of(self._step)):
            result = self._simulator.step(self._state)
            self._state, self._force = result.state, result.contacts[self._name].force

    def positions(self) -> Array:
        return np.asarray(self._simulator.positions(self._state))

    def force(self) -> Array:
        return np.asarray(self._force)


def full_space(scene: Scene, step: float) -> SoftprintEngine:
    """Full space as an experiment has it."""
    own = scene.experiment
    newton = NewtonSettings(own.dynamics.max_iterations)
    return _full(scene, PenaltyContact.of(own.contact), DynamicsSettings(step, newton))


def reference(scene: Scene, step: float = REFERENCE_STEP) -> SoftprintEngine:
    """Full space with shorter steps, stiffer contact, and a smaller tolerance."""
    law = PenaltyContact(REFERENCE_STIFFNESS, REFERENCE_REFINEMENT)
    newton = NewtonSettings(_REFERENCE_ITERATIONS, _REFERENCE_TOLERANCE)
    return _full(scene, law, DynamicsSettings(step, newton))


def reduced(
    scene: Scene, step: float, mechanics: BodyMechanics | None, correction: Correction | None
) -> SoftprintEngine:
    """A reduced model as an experiment has it."""
    own = scene.experiment
    simulator = Simulator(
        scene.body,
        [PlacedCollider(scene.collider.name, scene.collider, scene.path, correction)],
        contact=PenaltyContact.of(own.contact),
        mechanics=mechanics,
        gravity=scene.gravity,
        kinematic=_held(scene),
        settings=DynamicsSettings(step, NewtonSettings(own.dynamics.max_iterations)),
    )
    return SoftprintEngine(scene, simulator, step)


def settings(mechanics: BodyMechanics, trained: Path | None) -> Iterator[Setting]:
    """All rows of this project; trained: the correction file of `ours`."""

    def with_mechanics(scene: Scene, step: float) -> SoftprintEngine:
        return reduced(scene, step, mechanics, _untrained(scene, mechanics))

    def learned(path: Path, scene: Scene, step: float) -> SoftprintEngine:
        correction = load_correction(path, scene.body, scene.collider, mechanics)
        return reduced(scene, step, mechanics_of([correction], mechanics), correction)

    rows: dict[str, Callable[..., SoftprintEngine]] = {
        "full space": full_space,
        "bare": partial(reduced, mechanics=None, correction=None),
        "mechanics": with_mechanics,
    }
    if trained:
        rows["ours"] = partial(learned, trained)
    for name, make in rows.items():
        for step in STEPS:
            yield Setting(name, LAW, "", step, 0, partial(make, step=step))


def _full(scene: Scene, law: PenaltyContact, own: DynamicsSettings) -> SoftprintEngine:
    simulator = FullSpaceSimulator(
        scene.body,
        [PlacedCollider(scene.collider.name, scene.collider, scene.path)],
        contact=law,
        gravity=scene.gravity,
        kinematic=_held(scene),
        settings=own,
    )
    return SoftprintEngine(scene, simulator, own.time_step)


def _held(scene: Scene) -> list[KinematicHandle]:
    return [KinematicHandle(frame.name) for frame in scene.body.handles.frames]


def _untrained(scene: Scene, mechanics: BodyMechanics) -> ForceCorrection:
    """Whose dents are those of linear mechanics."""
    law, spec = PenaltyContact.of(scene.experiment.contact), ModelSpec(name="mechanics")
    model = ForceModel(options(spec, scene.body, law), scene.body.dim, scene.body.n_rows)
    return ForceCorrection("mechanics", model, scene.body, scene.collider, mechanics)
