"""A tactile pad with one rigid indenter, made from plain arguments: body, simulator and camera.

Without an experiment it is a coarse pad of its own, of the size and the material of `examples/gel_pad.toml`, which
needs no files.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from softprint.runtime.body import (
    ReducedBody,
    assemble_body,
    frame_in_box,
    place_handles,
)
from softprint.runtime.colliders import Collider
from softprint.runtime.colliders.pose import RigidPose
from softprint.runtime.contact import CoulombFriction, PenaltyContact
from softprint.runtime.dynamics import (
    DynamicsSettings,
    KinematicHandle,
    NewtonSettings,
    PlacedCollider,
    Simulator,
)
from softprint.runtime.dynamics.state import ReducedState, StepResult
from softprint.runtime.elasticity import make_material
from softprint.runtime.errors import SoftprintError
from softprint.runtime.experiment import Experiment, load_experiment
from softprint.runtime.learned.correction import Correction, mechanics_of
from softprint.runtime.mechanics.body_mechanics import BodyMechanics, compute_mechanics
from softprint.runtime.mesh import Mesh, box_mesh
from softprint.runtime.scenes.experiment_body import body_of_experiment, load_body_of
from softprint.runtime.touch.tactile_camera import TactileCamera

INDENTER = "indenter"
BARE, MECHANICS = "bare", "mechanics"
_WIDTH, _HEIGHTS = (
    0.025,
    (-0.001, 0.0, 0.0016, 0.0028, 0.0035, 0.004),
)  # m: back and layers of the pad without files
_ACROSS = 16  # cells
_YOUNG, _POISSON, _DENSITY = 1.23e5, 0.43, 1010.0
_STIFFNESS = 3e13  # N/m^4, of contact
_CONTACT_NODES = 3000


@dataclass(frozen=True, eq=False)
class PadParts:
    """What the pad and its world are: the body and its mechanics, None for the reduced model alone; the correction
    that was learned for the indenter, if any; the law of contact, friction, gravity (3,) [m/s^2], and the settings of a
    step."""

    body: ReducedBody
    mechanics: BodyMechanics | None
    correction: Correction | None
    contact: PenaltyContact
    friction: CoulombFriction | None
    gravity: Sequence[float]
    settings: DynamicsSettings

    @classmethod
    def make(cls, indenter: Collider, experiment: str | None, run: str | None, model: str) -> PadParts:
        """experiment: the path of an experiment file, of which body, contact and dynamics are taken; None: the pad
        without files; run: its run directory, for files of body, mechanics and corrections, runs/NAME by default;
        model: "bare", "mechanics", which is computed if there is no file of it, or the name of a trained correction.

        Raises SoftprintError where the experiment is not in 3D, has no frame, or where the correction is missing.
        """
        if experiment is None:
            if model not in (BARE, MECHANICS):
                raise SoftprintError(
                    f"model {model!r}: without an experiment there are only {BARE} and {MECHANICS}"
                )
            return cls._of_coarse_pad(model)
        spec = load_experiment(Path(experiment))
        folder = Path(run) if run is not None else Path("runs") / spec.name
        body = _body(spec, folder)
        if body.dim != 3 or not body.handles.frames:
            raise SoftprintError(
                f"{experiment}: a tactile pad is a body in 3D with a rigid frame that is held"
            )
        mechanics, correction = _model(spec, folder, body, indenter, model)
        friction = (
            CoulombFriction(spec.contact.friction, spec.contact.slip_velocity)
            if spec.contact.friction
            else None
        )
        newton = NewtonSettings(spec.dynamics.max_iterations, spec.dynamics.tolerance)
        settings = DynamicsSettings(spec.dynamics.time_step, newton)
        gravity = list(spec.dynamics.gravity)
        return cls(body, mechanics, correction, PenaltyContact.of(spec.contact), friction, gravity, settings)

    @classmethod
    def _of_coarse_pad(cls, model: str) -> PadParts:
        body, gravity = coarse_pad(), [0.0, 0.0, -9.81]
        mechanics = compute_mechanics(body, _CONTACT_NODES, True, gravity) if model == MECHANICS else None
        settings = DynamicsSettings(newton=NewtonSettings(40))
        return cls(body, mechanics, None, PenaltyContact(_STIFFNESS, 2), None, gravity, settings)

    def placed(self, indenter: Collider) -> PlacedCollider:
        """The indenter, posed with every step."""
        return PlacedCollider(INDENTER, indenter, correction=self.correction)

    @property
    def held(self) -> list[KinematicHandle]:
        """All frames: the back."""
        return [KinematicHandle(frame.name) for frame in self.body.handles.frames]


class TactilePad:
    """A pad that an indenter touches, with a camera for its upper side; markers, image, field: see `TactileCamera`."""

    def __init__(
        self,
        indenter: Collider,
        parts: PadParts,
        *,
        markers: Sequence[int],
        image: Sequence[int],
        field: Sequence[float] | None = None,
    ) -> None:
        self.parts = parts
        self.simulator = Simulator(
            parts.body,
            [parts.placed(indenter)],
            contact=parts.contact,
            mechanics=parts.mechanics,
            friction=parts.friction,
            gravity=parts.gravity,
            kinematic=parts.held,
            settings=parts.settings,
        )
        self.camera = TactileCamera(self.simulator, parts.body, markers=markers, image=image, field=field)
        self._start: ReducedState | None = None

    @property
    def time_step(self) -> float:
        """[s] of one step."""
        return self.simulator.settings.time_step

    def world_pose(self, position: ArrayLike, rotation: ArrayLike) -> RigidPose:
        """Of the indenter, from its position (3,) [m] and rotation vector (3,) in the frame of the side."""
        axes, origin = self.camera.side.axes, self.camera.side.origin
        own = RigidPose.from_rotation_vector(rotation, position)
        return RigidPose(axes.T, origin).compose(own)

    def start(self, pose: RigidPose) -> StepResult[ReducedState]:
        """The pad at rest under its weight, with the indenter away from it at a pose."""
        if self._start is None:
            self._start = self.simulator.settle(self.simulator.rest_state(poses={INDENTER: pose})).state
        state = replace(self._start, time=0.0, poses={INDENTER: pose}, contact=None)
        return self.simulator.settle(state)

    def step(self, state: ReducedState, pose: RigidPose) -> StepResult[ReducedState]:
        """One step of the simulator."""
        return self.simulator.step(state, {INDENTER: pose})


def coarse_pad() -> ReducedBody:
    """The pad without files: 7,680 tetrahedra, finer towards the surface that touches."""
    half, layers = 0.5 * _WIDTH, len(_HEIGHTS) - 1
    cubes = box_mesh([-half, -half, _HEIGHTS[0]], [half, half, _HEIGHTS[-1]], [_ACROSS, _ACROSS, layers])
    layer = (cubes.points[:, 2] - _HEIGHTS[0]) / (_HEIGHTS[-1] - _HEIGHTS[0]) * layers
    heights = np.array(_HEIGHTS)[layer.round().astype(int)]
    mesh = Mesh(np.column_stack([cubes.points[:, :2], heights]), cubes.cells)
    grid = [-0.009, -0.003, 0.003, 0.009]
    points = [[x, y, _HEIGHTS[-1]] for y in grid for x in grid]
    back = frame_in_box(mesh, "back", [[-1.0, -1.0, -1.0], [1.0, 1.0, 1e-6]])
    material = make_material("stable_neo_hookean", _YOUNG, _POISSON)
    return assemble_body(mesh, place_handles(mesh, points, [back]), material, _DENSITY, name="coarse_pad")


def _body(spec: Experiment, folder: Path) -> ReducedBody:
    path = folder / "body.h5"
    return load_body_of(spec, path) if path.is_file() else body_of_experiment(spec)


def _model(
    spec: Experiment, folder: Path, body: ReducedBody, indenter: Collider, model: str
) -> tuple[BodyMechanics | None, Correction | None]:
    """Mechanics and correction of a model by its name."""
    if model == BARE:
        return None, None
    if model == MECHANICS:
        from softprint.runtime.mechanics.mechanics_file import load_mechanics, mechanics_path

        file = mechanics_path(folder, _CONTACT_NODES)
        if file.is_file():
            return load_mechanics(file, body), None
        return compute_mechanics(body, _CONTACT_NODES, True, spec.dynamics.gravity), None
    from softprint.runtime.learned.correction_file import read_correction
    from softprint.runtime.scenes.playing import correction_path, trained_models

    path = correction_path(folder, model)
    if not path.is_file():
        known = ", ".join([BARE, MECHANICS, *trained_models(folder)])
        raise SoftprintError(f"there is no model {model!r}: looked for {path}; known models: {known}")
    correction = read_correction(path, body).on(indenter)
    return mechanics_of([correction], None), correction
