"""Makes the simulators of a session: one for each model, colliders and choice of what moves freely.

Files and colliders are read once. Making a simulator takes from a tenth of a second to some seconds, so a session has
it done on a thread of its own (`builder.py`).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from softprint.runtime.arrays import Array
from softprint.runtime.body.body import ReducedBody
from softprint.runtime.colliders import Collider, RigidPose
from softprint.runtime.colliders.build import build_collider
from softprint.runtime.colliders.kinds.table import ColliderTable
from softprint.runtime.dynamics.placed_collider import PlacedCollider
from softprint.runtime.dynamics.simulator import Simulator
from softprint.runtime.errors import SoftprintError
from softprint.runtime.experiment.experiment import CONDENSED
from softprint.runtime.learned.correction import Correction, mechanics_of
from softprint.runtime.rigid import FreeCollider, free_collider
from softprint.runtime.scenes.corrected_body import CorrectedBody, body_below, on_corrected_body
from softprint.runtime.scenes.model_name import ModelName
from softprint.runtime.scenes.playing import (
    BARE,
    correction_path,
    internal_models,
    joint_models,
    usual_models,
)
from softprint.runtime.scenes.scene import SceneParts, scene_parts, scene_simulator
from softprint.runtime.viewer.session.painting import Painter

if TYPE_CHECKING:
    from softprint.runtime.experiment import Experiment, SceneSpec
    from softprint.runtime.learned.correction_file import TrainedCorrection


@dataclass(frozen=True, eq=False)
class Plan:
    """What to make. tables: of the colliders; free: the density [kg/m^3] of those that move freely; poses: where the
    colliders are."""

    model: str
    tables: tuple[ColliderTable, ...]
    free: Mapping[str, float]
    poses: Mapping[str, RigidPose]

    @property
    def key(self) -> tuple[object, ...]:
        """Equal for plans of the same simulator."""
        tables = tuple(table.model_dump_json() for table in self.tables)
        return (self.model, tables, tuple(sorted(self.free.items())))


@dataclass(frozen=True, eq=False)
class Model:
    """A finished simulator. rest_rows: of the body at rest under its weight; note: what a user should know."""

    name: str
    simulator: Simulator
    painter: Painter
    rest_rows: Array
    note: str = ""


class Workshop:
    """Makes the models of one scene of an experiment; out: the run directory with its corrections."""

    def __init__(self, experiment: Experiment, body: ReducedBody, scene: SceneSpec, out: Path) -> None:
        self.experiment, self.body, self.scene, self.out = experiment, body, scene, out
        self.parts: SceneParts = scene_parts(experiment, scene)
        self._colliders: dict[str, Collider] = {
            experiment.collider(placed.name).model_dump_json(): placed.collider
            for placed in self.parts.colliders
        }
        self._trained: dict[str, TrainedCorrection] = {}
        self._bodies: dict[str, CorrectedBody] = {}
        self._free: dict[tuple[str, float], FreeCollider] = {}
        self._rest: dict[str, Array] = {}
        self._made: dict[tuple[object, ...], Model] = {}

    @property
    def names(self) -> list[str]:
        """The models that can play: the bare subspace, and those of the run directory, joint ones too."""
        return list(dict.fromkeys([*usual_models(self.out), *joint_models(self.out)]))

    @property
    def tables(self) -> tuple[ColliderTable, ...]:
        """Those of the scene's colliders."""
        return tuple(self.experiment.collider(placed.name) for placed in self.parts.colliders)

    @property
    def densities(self) -> dict[str, float]:
        """[kg/m^3] of the scene's free colliders."""
        found = {}
        for placed in self.parts.colliders:
            if placed.free is not None:
                found[placed.name] = placed.free.mass.mass / _volume(placed)
        return found

    def start_poses(self) -> dict[str, RigidPose]:
        """Where the scene has its colliders at the start."""
        return {
            placed.name: placed.free.pose if placed.free is not None else _first(placed)
            for placed in self.parts.colliders
        }

    def collider(self, table: ColliderTable) -> Collider:
        """The collider of a table. Raises SoftprintError where it cannot be built, or has another dimension."""
        key = table.model_dump_json()
        if key not in self._colliders:
            made = build_collider(table, self.experiment.base_dir)
            if made.dim != self.body.dim:
                raise SoftprintError(
                    f"collider {made.name!r} is {made.dim}D, but the body is {self.body.dim}D: choose another shape"
                )
            self._colliders[key] = made
        return self._colliders[key]

    def make(self, plan: Plan) -> Model:
        """The model of a plan; one that was made before is made no second time. Raises SoftprintError."""
        if plan.key not in self._made:
            if len(self._made) > 12:  # each holds some megabytes
                self._made.clear()
            self._made[plan.key] = self._new(plan)
        return self._made[plan.key]

    def _new(self, plan: Plan) -> Model:
        shapes = {table.name: self.collider(table) for table in plan.tables}
        corrections, note = self._corrections(plan.model, shapes)
        own = self._body(plan.model, corrections)
        placed = [
            PlacedCollider(
                name,
                shape,
                free=self._free_collider(shape, plan.poses[name], plan.free[name])
                if name in plan.free
                else None,
            )
            for name, shape in shapes.items()
        ]
        simulator = self._simulator(placed, corrections.values(), own)
        painter = Painter(simulator)
        plain = own.mechanics is None and own.internal is None
        rest_rows = self._rest_rows("" if plain else plan.model, own)
        return Model(plan.model, simulator, painter, rest_rows, note)

    def _body(self, model: str, corrections: Mapping[str, Correction]) -> CorrectedBody:
        """The body of a model without its contact. The mechanics are those of its contact correction, if it has one."""
        below = "" if model == BARE else model
        if model not in (BARE, CONDENSED, *internal_models(self.out)):
            below = self._below(model)
        own = self._body_below(below)
        return own._replace(mechanics=mechanics_of(corrections.values(), own.mechanics))

    def _below(self, model: str) -> str:
        return ModelName.of(model).below(self._read(model).header.added_to)

    def _body_below(self, name: str) -> CorrectedBody:
        """As it is, with static condensation, or with an internal correction."""
        if name not in self._bodies:
            self._bodies[name] = body_below(self.body, self.out, name, self.parts.gravity)
        return self._bodies[name]

    def _corrections(self, model: str, shapes: Mapping[str, Collider]) -> tuple[dict[str, Correction], str]:
        if model in (BARE, CONDENSED, *internal_models(self.out)):
            return {}, ""
        trained = self._read(model)
        corrections = {name: trained.on(shape) for name, shape in shapes.items() if trained.is_for(shape)}
        if (below := self._below(model)) != trained.header.added_to:
            own = self._body_below(below)
            corrections = {name: on_corrected_body(one, own) for name, one in corrections.items()}
        without = [name for name in shapes if name not in corrections]
        if not without:
            return corrections, ""
        return corrections, (
            f"{model} was trained for the collider {trained.header.collider!r}: {', '.join(without)} is played bare"
        )

    def _read(self, model: str) -> TrainedCorrection:
        name = ModelName.of(model).correction
        if name not in self._trained:
            path = correction_path(self.out, name)
            if not path.is_file():
                raise SoftprintError(
                    f"there is no model {name!r}: looked for {path}; known models: {', '.join(self.names)}"
                )
            from softprint.runtime.learned.correction_file import read_correction

            self._trained[name] = read_correction(path, self.body)
        return self._trained[name]

    def _free_collider(self, shape: Collider, pose: RigidPose, density: float) -> FreeCollider:
        key = (f"{id(shape)}", density)
        if key not in self._free:
            self._free[key] = free_collider(shape, pose, density=density)
        return self._free[key]

    def _rest_rows(self, key: str, own: CorrectedBody) -> Array:
        """The body under its own weight, without colliders; undeformed where nothing holds it."""
        if key not in self._rest:
            if not self.parts.held:
                return self.body.rest_rows
            settled = self._simulator((), (), own).settle()
            self._rest[key] = settled.state.rows if settled.converged else self.body.rest_rows
        return self._rest[key]

    def _simulator(
        self,
        placed: Sequence[PlacedCollider],
        corrections: Iterable[Correction],
        own: CorrectedBody,
    ) -> Simulator:
        parts = replace(self.parts, colliders=tuple(placed))
        return scene_simulator(own.body, parts, corrections, own.mechanics, own.internal)


def _first(placed: PlacedCollider) -> RigidPose:
    if placed.path is None:
        return RigidPose.identity(placed.collider.dim)
    return placed.path.pose(0.0)


def _volume(placed: PlacedCollider) -> float:
    from softprint.runtime.rigid.mass import mass_properties

    return mass_properties(placed.collider).mass
