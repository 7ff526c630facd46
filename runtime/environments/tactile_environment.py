"""What the environments of a tactile pad have in common.

The pad looks up and stands still; an indenter above it is moved by its velocity. Lengths in observations are in
millimetres and forces in newtons, so that numbers are of order one; everything is in the frame of the pad's side: x, y
in its plane, z along its normal, the origin in the middle of its surface.

Action: (3,) velocity of the indenter in [-1, 1], times `speed` [m/s]. Each takes `repeat` time steps. The indenter
stays within a box.

Observation, a dictionary of float32, of what `observe` names, and always `indenter` and what the task adds:

    markers    (n, 3) displacement of the markers [mm], the last along the normal
    depth      (rows, columns) depth of the surface [mm]
    force      (3,) on the pad [N]
    indenter   (6,) its position [mm] and rotation vector

An episode terminates with success, `info["success"]`. It is truncated after `max_steps` actions, and by a step of the
simulation that has not converged or in which the indenter has pierced the pad: `info["reason"]` says why, and
`info["status"]` with the name of the step's status.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from typing import Any, ClassVar

import gymnasium
import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from softprint.runtime.arrays import Array
from softprint.runtime.colliders import Collider, RigidPose
from softprint.runtime.dynamics.state import ReducedState, StepResult
from softprint.runtime.environments.picture import Pixels, tactile_picture
from softprint.runtime.environments.tactile_pad import PadParts, TactilePad
from softprint.runtime.errors import SoftprintError
from softprint.runtime.touch.tactile_camera import TactileImage

Observation = dict[str, NDArray[np.float32]]

MILLIMETRES = 1e3
SENSES = ("markers", "depth", "force")
# Bounds of observations, which are clipped to them.
_LARGEST = {"markers": 10.0, "depth": 10.0, "force": 100.0, "indenter": 50.0}


class TactileEnv(gymnasium.Env[Observation, NDArray[np.float32]]):
    """A task with a tactile pad. All arguments are plain, so that an environment can be made in any process.

    experiment, run, model: see `PadParts.make`; observe: some of "markers", "depth" and "force", by default those of
    the task; markers, image: see `TactileCamera`; max_steps: actions of an episode; speed: [m/s] of an action of one
    along an axis; repeat: time steps of an action. Raises SoftprintError for senses that there are not, and as
    `PadParts.make` does.
    """

    metadata: dict[str, Any] = {"render_modes": ["rgb_array"], "render_fps": 30}  # noqa: RUF012  (as of Env)
    senses: ClassVar[tuple[str, ...]] = ("markers", "force")
    # (3,) [m] where the indenter's origin may be: below, beside and above.
    lower: Array
    upper: Array

    def __init__(
        self,
        experiment: str | None = None,
        run: str | None = None,
        model: str = "mechanics",
        observe: Sequence[str] | None = None,
        markers: Sequence[int] = (12, 9),
        image: Sequence[int] = (64, 48),
        max_steps: int = 150,
        speed: float = 0.01,
        repeat: int = 2,
        render_mode: str | None = None,
    ) -> None:
        observe = self.senses if observe is None else observe
        unknown = [sense for sense in observe if sense not in SENSES]
        if unknown or isinstance(observe, str):
            raise SoftprintError(f"observe {observe!r}: must be some of {', '.join(SENSES)}")
        if render_mode not in (None, *self.metadata["render_modes"]):
            raise SoftprintError(f"render_mode {render_mode!r}: must be rgb_array, or none")
        if max_steps < 1 or repeat < 1 or not speed > 0:
            raise SoftprintError("max_steps, repeat and speed must be positive")
        self.render_mode, self.observe = render_mode, tuple(observe)
        self.max_steps, self.speed, self.repeat = max_steps, speed, repeat
        shape = self.indenter()
        self.pad = TactilePad(
            shape, PadParts.make(shape, experiment, run, model), markers=markers, image=image
        )
        self.action_space = spaces.Box(-1.0, 1.0, (3,), np.float32)
        shapes = {
            "markers": (len(self.pad.camera.places), 3),
            "depth": (image[1], image[0]),
            "force": (3,),
            "indenter": (6,),
        }
        self.observation_space = spaces.Dict(
            {
                **{name: _box(_LARGEST[name], shapes[name]) for name in (*self.observe, "indenter")},
                **self.goal_space(),
            }
        )
        self.position, self.rotation = np.zeros(3), np.zeros(3)
        self.seen: TactileImage | None = None
        #: Of the indenter's shape, at the start of the episode and after every time step since, to replay it.
        self.poses: list[RigidPose] = []
        self._result: StepResult[ReducedState] | None = None
        self._taken = self._held = 0

    @abstractmethod
    def indenter(self) -> Collider:
        """The shape that touches the pad."""

    @abstractmethod
    def goal_space(self) -> dict[str, spaces.Space[Any]]:
        """What the task adds to the observation."""

    @abstractmethod
    def begin(self) -> None:
        """Draw a start, from `np_random`: position and rotation of the indenter, away from the pad, and the goal."""

    @abstractmethod
    def goal(self) -> Observation:
        """What the task adds to the observation."""

    @abstractmethod
    def judged(self, seen: TactileImage) -> tuple[float, bool, dict[str, Any]]:
        """Reward, whether the goal is met at this moment, and entries of `info`."""

    #: The reward of success, and for how many actions in a row the goal has to be met.
    success_reward: ClassVar[float] = 10.0
    held_for: ClassVar[int] = 10

    def _checked(self, action: NDArray[np.float32]) -> Array:
        """An action as numbers; raises SoftprintError, before anything has moved, where it is none."""
        given = np.asarray(action, dtype=float)
        if given.shape != self.action_space.shape or not np.isfinite(given).all():
            shape = " x ".join(map(str, self.action_space.shape or ()))
            raise SoftprintError(f"an action is {shape} finite numbers, not {given.tolist()}")
        return given

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """See `gymnasium.Env.reset`. There are no options."""
        super().reset(seed=seed)
        self._taken = self._held = 0
        self.begin()
        self.poses = [self._pose()]
        self._result = self.pad.start(self.poses[0])
        self.seen = self.pad.camera.see(self._result)
        _, _, info = self.judged(self.seen)
        return self._observed(self.seen), {**info, "success": False}

    def step(self, action: NDArray[np.float32]) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """See `gymnasium.Env.step`."""
        if self._result is None:
            raise SoftprintError("the environment has to be reset before its first step")
        velocity = self.speed * np.clip(self._checked(action), -1.0, 1.0)
        for _ in range(self.repeat):
            moved = self.position + self.pad.time_step * velocity
            self.position = np.clip(moved, self.lower, self.upper)
            self.poses.append(self._pose())
            self._result = self.pad.step(self._result.state, self.poses[-1])
            if not self._result.converged:
                break
        self.seen = self.pad.camera.see(self._result)
        self._taken += 1
        reward, met, info = self.judged(self.seen)
        reward = reward if np.isfinite(reward) else -1.0  # of a step that failed
        self._held = self._held + 1 if met else 0
        failed = not self._result.converged
        success = self._held >= self.held_for and not failed
        truncated = not success and (failed or self._taken >= self.max_steps)
        info |= {"success": success, "status": str(getattr(self._result.status, "name", self._result.status))}
        if truncated:
            info["reason"] = self._result.reason if failed else f"{self.max_steps} steps are over"
        return self._observed(self.seen), reward + success * self.success_reward, success, truncated, info

    def render(self) -> Pixels | None:
        """The depth image with the markers; None without a render mode."""
        if self.render_mode is None or self.seen is None:
            return None
        return tactile_picture(self.pad.camera, self.seen, 1e-3)

    def _pose(self) -> RigidPose:
        """Of the indenter's shape."""
        return self.pad.world_pose(self.position, self.rotation)

    def _observed(self, seen: TactileImage) -> Observation:
        """Clipped to the space, with zeros for what is not seen."""
        values = {
            "markers": MILLIMETRES * seen.markers,
            "depth": MILLIMETRES * seen.depth,
            "force": seen.force,
            "indenter": np.concatenate([MILLIMETRES * self.position, self.rotation]),
        }
        kept = {
            name: np.clip(np.nan_to_num(values[name]), -_LARGEST[name], _LARGEST[name]).astype(np.float32)
            for name in (*self.observe, "indenter")
        }
        return {**kept, **self.goal()}


def _box(largest: float, shape: tuple[int, ...]) -> spaces.Box:
    return spaces.Box(-largest, largest, shape, np.float32)
