"""What can play a scene: the bare subspace, the subspace with a correction, or full space.

Models that live outside the runtime announce a `ModelFactory` in the entry point group ``softprint.models``;
its name there is the model's name (`full` for full space).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from importlib.metadata import entry_points
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

from runtime.arrays import Array, IntArray
from runtime.body.body import ReducedBody
from runtime.dynamics.corrected_nodes import Snapshot
from runtime.dynamics.simulator import Simulator
from runtime.dynamics.state import ReducedState, StepResult
from runtime.errors import SoftprintError
from runtime.scenes.scene import scene_parts, scene_simulator

if TYPE_CHECKING:
    from runtime.experiment import Experiment, SceneSpec

MODEL_GROUP = "softprint.models"
BARE = "bare"


class SceneModel(Protocol):
    """Plays one scene. A state is opaque but for its `time` [s] and `poses` of the colliders."""

    def start(self) -> StepResult[Any]:
        """Frame 0: static equilibrium under gravity and springs with the colliders where the scene begins; at
        rest and undeformed where nothing holds the body."""
        ...

    def step(self, state: Any) -> StepResult[Any]:
        """One time step of the experiment."""
        ...

    def positions(self, state: Any) -> Array:
        """(n_nodes, dim) [m] in the node order of the body's mesh."""
        ...

    def surface_positions(self, state: Any) -> Array:
        """(s, dim) [m]: what a frame shows of the body's surface, corrections included."""
        ...

    def follow(self, nodes: IntArray) -> Callable[[Any], Array]:
        """Where some nodes (n,) of the mesh are, (n, dim) [m], as a function of the state."""
        ...

    def rows(self, state: Any) -> Array:
        """(n_rows, dim) of the nearest reduced state (`ReducedBody.project` for full positions)."""
        ...


class ModelFactory(Protocol):
    """``out`` is the run directory, for what the model was trained into or keeps there."""

    def __call__(
        self, experiment: Experiment, body: ReducedBody, scene: SceneSpec, out: Path
    ) -> SceneModel: ...


class ReducedModel:
    """A scene in the subspace."""

    def __init__(self, simulator: Simulator, held: bool) -> None:
        self._simulator = simulator
        self._held = held

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


def correction_path(out: Path, name: str) -> Path:
    """Where `train` leaves the correction of that name."""
    return out / "corrections" / f"{name}.safetensors"


def trained_models(out: Path) -> list[str]:
    """Names of the corrections in a run directory."""
    return sorted(file.stem for file in (out / "corrections").glob("*.safetensors"))


def corrected_model(
    experiment: Experiment, body: ReducedBody, scene: SceneSpec, out: Path, name: str
) -> ReducedModel:
    """The subspace with the correction that was trained under that name."""
    path = correction_path(out, name)
    if not path.is_file():
        known = ", ".join([BARE, *trained_models(out)])
        raise SoftprintError(
            f"there is no model {name!r}: looked for {path}. Known here: {known}; `softprint train` makes "
            f"corrections; of installed packages come: {', '.join(_announced()) or 'no others'}"
        )
    return model_of_file(experiment, body, scene, path)


def model_of_file(experiment: Experiment, body: ReducedBody, scene: SceneSpec, path: Path) -> ReducedModel:
    """The subspace with the correction of a file, on every collider of the scene that it is for."""
    parts = scene_parts(experiment, scene)
    # Imported here, with torch, which takes a second that the other models need not wait.
    from runtime.learned.correction_file import read_correction

    trained = read_correction(path, body)
    corrections = [trained.on(placed.collider) for placed in parts.colliders if trained.is_for(placed.name)]
    if not corrections:
        raise SoftprintError(
            f"scene {scene.name!r} has no collider {trained.header.collider!r}, for which {path.name} was trained: "
            f"play it with the model {BARE!r}"
        )
    return ReducedModel(scene_simulator(body, parts, corrections), parts.held)


def _announced() -> list[str]:
    return sorted({point.name for point in entry_points(group=MODEL_GROUP)})


def build_model(
    experiment: Experiment, body: ReducedBody, scene: SceneSpec, out: Path, name: str
) -> SceneModel:
    """The model of that name: `bare`, one that a package announces, or a trained correction."""
    if name == BARE:
        return bare_model(experiment, body, scene)
    for point in entry_points(group=MODEL_GROUP):
        if point.name == name:
            factory: ModelFactory = point.load()
            return factory(experiment, body, scene, out)
    return corrected_model(experiment, body, scene, out, name)


def play(model: SceneModel, n_steps: int) -> Iterator[StepResult[Any]]:
    """Frame 0, and then n_steps steps."""
    result = model.start()
    yield result
    for _ in range(n_steps):
        result = model.step(result.state)
        yield result
