"""The models that can play a scene: the bare subspace, the subspace with a correction, or full space.

Models outside the runtime register a `ModelFactory` in the entry point group ``softprint.models``;
its name there is the model's name (`full` for full space).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from importlib.metadata import entry_points
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

from softprint.runtime.arrays import Array, IntArray
from softprint.runtime.body.body import ReducedBody
from softprint.runtime.dynamics.corrected_nodes import Snapshot
from softprint.runtime.dynamics.placed_collider import PlacedCollider
from softprint.runtime.dynamics.simulator import Simulator
from softprint.runtime.dynamics.state import ReducedState, StepResult
from softprint.runtime.errors import SoftprintError
from softprint.runtime.experiment.experiment import CONDENSED
from softprint.runtime.learned.correction import mechanics_of
from softprint.runtime.scenes.corrected_body import (
    body_below,
    condensed_mechanics,
    corrected_body,
    internal_path,
    on_corrected_body,
)
from softprint.runtime.scenes.model_name import ON, ModelName
from softprint.runtime.scenes.scene import find_scene, scene_parts, scene_simulator, scene_steps

if TYPE_CHECKING:
    from softprint.runtime.experiment import Experiment, SceneSpec

MODEL_GROUP = "softprint.models"
BARE = "bare"


class SceneModel(Protocol):
    """Plays one scene. A state is opaque except for its `time` [s] and the `poses` of the colliders."""

    @property
    def colliders(self) -> Sequence[PlacedCollider]:
        """The colliders of the scene, in its order."""
        ...

    def start(self) -> StepResult[Any]:
        """Frame 0: static equilibrium under gravity and springs with the colliders at the scene's start; at rest and
        undeformed if nothing fixes the body."""
        ...

    def step(self, state: Any) -> StepResult[Any]:
        """One time step of the experiment."""
        ...

    def positions(self, state: Any) -> Array:
        """(n_nodes, dim) [m] in the node order of the body's mesh."""
        ...

    def surface_positions(self, state: Any) -> Array:
        """(s, dim) [m]: the points of the body's surface that a frame shows, corrections included."""
        ...

    def follow(self, nodes: IntArray) -> Callable[[Any], Array]:
        """The positions (n, dim) [m] of some nodes (n,) of the mesh, as a function of the state."""
        ...

    def rows(self, state: Any) -> Array:
        """(n_rows, dim) of the nearest reduced state (`ReducedBody.project` for full positions)."""
        ...


class ModelFactory(Protocol):
    """``out`` is the run directory, for trained corrections and files of the model."""

    def __call__(
        self, experiment: Experiment, body: ReducedBody, scene: SceneSpec, out: Path
    ) -> SceneModel: ...


class ReducedModel:
    """A scene in the subspace."""

    def __init__(self, simulator: Simulator, held: bool) -> None:
        self._simulator = simulator
        self._held = held

    @property
    def colliders(self) -> Sequence[PlacedCollider]:
        """See `SceneModel`."""
        return self._simulator.colliders

    def start(self) -> StepResult[ReducedState]:
        """See `SceneModel`."""
        return self._simulator.settle() if self._held else self._simulator.at_rest()

    def step(self, state: ReducedState) -> StepResult[ReducedState]:
        """One step of `Simulator.step`."""
        return self._simulator.step(state)

    def positions(self, state: ReducedState) -> Array:
        """(n_nodes, dim) [m], corrections included."""
        return self._simulator.positions(state)

    def surface_positions(self, state: ReducedState) -> Array:
        """(s, dim) [m] the surface samples, corrections included."""
        return self._simulator.surface_positions(state)

    def surface_snapshot(self, state: ReducedState) -> Snapshot:
        """See `Simulator.surface_snapshot`."""
        return self._simulator.surface_snapshot(state)

    def surface_drawn(self, snapshot: Snapshot) -> Array:
        """See `Simulator.surface_drawn`."""
        return self._simulator.surface_drawn(snapshot)

    def follow(self, nodes: IntArray) -> Callable[[ReducedState], Array]:
        """See `Simulator.follow`."""
        return self._simulator.follow(nodes)

    def rows(self, state: ReducedState) -> Array:
        """(n_rows, dim) the handle rows themselves."""
        return state.rows


def bare_model(experiment: Experiment, body: ReducedBody, scene: SceneSpec) -> ReducedModel:
    """The subspace alone."""
    parts = scene_parts(experiment, scene)
    return ReducedModel(scene_simulator(body, parts), parts.held)


def condensed_model(experiment: Experiment, body: ReducedBody, scene: SceneSpec) -> ReducedModel:
    """The subspace with static condensation, computed here; contact is penalty contact."""
    parts = scene_parts(experiment, scene)
    mechanics = condensed_mechanics(body, parts.gravity)
    return ReducedModel(scene_simulator(body, parts, mechanics=mechanics), parts.held)


def internal_model(experiment: Experiment, body: ReducedBody, scene: SceneSpec, path: Path) -> ReducedModel:
    """The subspace, or static condensation, with the internal correction of a file; contact is penalty contact."""
    parts = scene_parts(experiment, scene)
    own = corrected_body(body, path, parts.gravity)
    simulator = scene_simulator(own.body, parts, mechanics=own.mechanics, internal=own.internal)
    return ReducedModel(simulator, parts.held)


def correction_path(out: Path, name: str) -> Path:
    """The file that `train` writes for the correction of that name."""
    return out / "corrections" / f"{name}.safetensors"


def trained_models(out: Path) -> list[str]:
    """Names of the corrections in a run directory."""
    return sorted(file.stem for file in (out / "corrections").glob("*.safetensors"))


def internal_models(out: Path) -> list[str]:
    """Names of the internal corrections in a run directory."""
    return sorted(file.stem for file in (out / "internal").glob("*.safetensors"))


def joint_models(out: Path) -> list[str]:
    """Names of the corrections by contact forces on each internal correction of a run directory, see `ModelName`."""
    internal = internal_models(out)
    return [
        f"{name}{ON}{below}" for name in (_by_contact_forces(out) if internal else []) for below in internal
    ]


def _by_contact_forces(out: Path) -> Iterator[str]:
    """Of the corrections trained without an internal one; damaged files are told of where they are played."""
    from softprint.runtime.learned.correction_file import read_header

    for name in trained_models(out):
        with suppress(SoftprintError):
            header = read_header(correction_path(out, name))
            if header.mechanics_hash and not header.added_to:
                yield name


def usual_models(out: Path) -> list[str]:
    """What plays a scene where no model is named: the bare subspace and all that is trained; static condensation, too,
    where internal corrections are."""
    internal = internal_models(out)
    return [BARE, *trained_models(out), *([CONDENSED] if internal else []), *internal]


def corrected_model(
    experiment: Experiment, body: ReducedBody, scene: SceneSpec, out: Path, name: str
) -> ReducedModel:
    """The subspace with the correction that was trained under that name; see `ModelName` for two in one."""
    own = ModelName.of(name)
    return model_of_file(experiment, body, scene, correction_path(out, own.correction), own.internal)


def check_model(out: Path, name: str) -> None:
    """Raises SoftprintError where `build_model` finds no model of that name."""
    own = ModelName.of(name)
    path = correction_path(out, own.correction)
    if name in (BARE, CONDENSED, *_announced()) or internal_path(out, name).is_file() or path.is_file():
        return
    known = ", ".join([BARE, CONDENSED, *trained_models(out), *internal_models(out)])
    raise SoftprintError(
        f"there is no model {own.correction!r}: looked for {path}. Known models: {known}; `softprint train` makes "
        f"corrections; models of installed packages: {', '.join(_announced()) or 'no others'}"
    )


def model_of_file(
    experiment: Experiment, body: ReducedBody, scene: SceneSpec, path: Path, internal: str = ""
) -> ReducedModel:
    """The subspace with the correction of a file, on every collider of the scene that it applies to; internal: the
    internal correction that it acts on, of the run directory of that file, if not that of its training."""
    parts = scene_parts(experiment, scene)
    # Imported here, because torch takes a second to load and the other models do not need it.
    from softprint.runtime.learned.correction_file import read_correction

    trained = read_correction(path, body)
    below = ModelName(path.stem, internal).below(trained.header.added_to)
    own = body_below(body, path.parent.parent, below, parts.gravity)
    corrections = [
        trained.on(placed.collider) for placed in parts.colliders if trained.is_for(placed.collider)
    ]
    if not corrections:
        raise SoftprintError(
            f"scene {scene.name!r} has no collider {trained.header.collider!r}, for which {path.name} was trained: "
            f"play it with the model {BARE!r}"
        )
    if below != trained.header.added_to:
        corrections = [on_corrected_body(correction, own) for correction in corrections]
    mechanics = mechanics_of(corrections, own.mechanics)
    return ReducedModel(scene_simulator(own.body, parts, corrections, mechanics, own.internal), parts.held)


def _announced() -> list[str]:
    return sorted({point.name for point in entry_points(group=MODEL_GROUP)})


def build_model(
    experiment: Experiment, body: ReducedBody, scene: SceneSpec, out: Path, name: str
) -> SceneModel:
    """The model of that name: `bare`, `condensed`, one that a package registers, or a trained correction."""
    if name == BARE:
        return bare_model(experiment, body, scene)
    if name == CONDENSED:
        return condensed_model(experiment, body, scene)
    for point in entry_points(group=MODEL_GROUP):
        if point.name == name:
            factory: ModelFactory = point.load()
            return factory(experiment, body, scene, out)
    check_model(out, name)
    if internal_path(out, name).is_file():
        return internal_model(experiment, body, scene, internal_path(out, name))
    return corrected_model(experiment, body, scene, out, name)


def simulate(
    experiment: Experiment, body: ReducedBody, scene: str, run: Path | str, model: str = BARE
) -> Iterator[StepResult[Any]]:
    """Frame 0 and every step of a scene of an experiment, in order; model: `bare`, `full`, or the name of a
    correction that was trained into the run directory. Raises SoftprintError if there is no such scene or model."""
    spec = find_scene(experiment, scene)
    player = build_model(experiment, body, spec, Path(run), model)
    yield from play(player, scene_steps(experiment, spec))


def play(model: SceneModel, n_steps: int) -> Iterator[StepResult[Any]]:
    """Frame 0 and n_steps steps."""
    result = model.start()
    yield result
    for _ in range(n_steps):
        result = model.step(result.state)
        yield result
