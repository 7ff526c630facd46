"""An interactive simulation: commands in, one step at a time, orders for pictures and events out.

A session knows nothing of windows, browsers, clocks or processes, so a test drives it as the page does:

    session = Session(Workshop(experiment, body, scene, out))
    session.handle(LeadCollider("ball", position))
    results = session.advance()
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from softprint.runtime.colliders import RigidPose
from softprint.runtime.colliders.kinds.table import ColliderTable
from softprint.runtime.dynamics.state import ReducedState, StepResult
from softprint.runtime.errors import SoftprintError
from softprint.runtime.rigid import RigidMotion
from softprint.runtime.viewer.session import commands as ask
from softprint.runtime.viewer.session.builder import Builder
from softprint.runtime.viewer.session.hands import Hands
from softprint.runtime.viewer.session.painting import QUANTITIES
from softprint.runtime.viewer.session.player import Player
from softprint.runtime.viewer.session.recording import FOLDER, Recording
from softprint.runtime.viewer.session.workshop import Model, Plan, Workshop

Results = tuple[StepResult[ReducedState], ...]

# A free collider this many body sizes away from the body has fallen off, and comes back to its start.
_FAR = 4.0
# Limits of what a user may set.
_SPEEDS = (0.01, 10.0)
MOST_COLLIDERS, MOST_MODELS = 8, 2
# The longest recording [frames]: at 60 a second some minutes, each with some ten kilobytes in memory.
LONGEST = 18_000


class Session:
    """One body, its colliders, and the one or two models that play. Raises SoftprintError if the first model cannot be
    made."""

    def __init__(self, workshop: Workshop, models: Sequence[str] = ("bare",)) -> None:
        self.workshop, self.body = workshop, workshop.body
        self.settings = workshop.parts.settings
        self.pace, self.quantity = ask.SetPace(), "displacement"
        self.tables: tuple[ColliderTable, ...] = workshop.tables
        self.free: dict[str, float] = dict(workshop.densities)
        self.start_poses: dict[str, RigidPose] = workshop.start_poses()
        self.hands = Hands(self.body, workshop.parts, self.start_poses)
        self.recording: Recording | None = None
        self.finished_recordings: list[Recording] = []
        self.ended = False
        self._events: list[ask.Event] = []
        self._builder = Builder(workshop)
        self._steps_wanted = 0
        plans = [self._plan(name) for name in self._checked(models)]
        self.players = [self._player(workshop.make(plan), 0.0, {}) for plan in plans]
        self._wished = (tuple(models), self.tables, dict(self.free))
        self._hold()
        self._tell()

    # ---- what the page asks for -------------------------------------------------------------------------------

    def handle(self, command: ask.Command) -> None:
        """Do what a command says; a command that cannot be done becomes a notice and changes nothing."""
        try:
            self._do(command)
        except SoftprintError as error:
            self._say(str(error), "bad")

    def events(self) -> list[ask.Event]:
        """What has happened since the last call."""
        events, self._events = self._events, []
        return events

    @property
    def running(self) -> bool:
        """Whether there is a step to take."""
        return not self.pace.paused or self._steps_wanted > 0

    @property
    def time(self) -> float:
        """Simulated [s]."""
        return float(self.players[0].state.time)

    def advance(self) -> Results:
        """One step of every model. A step that is impossible sets the body back to its start, with a notice."""
        self._steps_wanted = max(0, self._steps_wanted - 1)
        self.fetch()
        poses = self.hands.advance(self.settings.time_step)
        led = {name: pose for name, pose in poses.items() if name not in self.free}
        try:
            results = tuple(player.step(led) for player in self.players)
        except SoftprintError as error:
            self._say(f"{error}; the body is back at its start", "bad")
            self._reset()
            return ()
        self._follow_free()
        if self.recording is not None:
            handles = {handle: path.follower.pose for handle, path in self.hands.handles.items()}
            self.recording.add(results, handles, self.hands.grab is not None)
            if len(self.recording.frames) >= LONGEST:
                self._end_recording("the recording was ended: it is as long as one may be")
        return results

    def fetch(self, wait: bool = False) -> bool:
        """Put models that have been made meanwhile in place; whether there were any."""
        try:
            made = self._builder.fetch(wait)
        except SoftprintError as error:
            # What was wished cannot be had: the wish is what there is again.
            names = tuple(player.model.name for player in self.players)
            self._wished = (names, self.tables, dict(self.free))
            self._say(str(error), "bad")
            self._tell()
            return False
        if made is None:
            return False
        self._put_in_place(made)
        return True

    def close(self) -> None:
        """End a recording, and the thread that makes models."""
        self._end_recording("")
        self.ended = True
        self._builder.close()

    def setting(self) -> ask.Setting:
        """What the session is made of."""
        return ask.Setting(
            tuple(player.model.name for player in self.players),
            self.tables,
            tuple(self.free),
            None if self.recording is None else self.recording.seconds,
            self._builder.what,
            tuple(self.hands.handles),
        )

    # ---- commands ---------------------------------------------------------------------------------------------

    def _do(self, command: ask.Command) -> None:
        match command:
            case ask.LeadCollider():
                self.hands.lead_collider(command.name, command.position, command.rotation)
                if command.name in self.free:  # it is held while it is led
                    self._free({k: v for k, v in self._wished[2].items() if k != command.name})
            case ask.DropCollider():
                self._drop(command)
            case ask.SetShapes():
                self._set_shapes(command.tables)
            case ask.GrabBody():
                self.hands.grab_body(command.point, command.stiffness, self.players[0].state.rows)
                self._hold()
            case ask.PullBody():
                self.hands.pull_body(command.target)
            case ask.LetGo():
                self.hands.grab = None
                self._hold()
            case ask.LeadHandle():
                self._lead_handle(command)
            case ask.SetModels():
                self._wish(models=self._checked(command.names), what=" and ".join(command.names))
            case ask.SetColour():
                if command.quantity not in QUANTITIES:
                    raise SoftprintError(f"a body is not coloured by {command.quantity!r}")
                self.quantity = command.quantity
            case ask.SetPace():
                self._set_pace(command)
            case ask.StepOnce():
                self._steps_wanted = 1
            case ask.Reset():
                self._reset()
            case ask.Record():
                self._record(command.on, command.film)
            case ask.Tell():
                self._tell()
            case ask.Quit():
                self.close()

    def _checked(self, models: Sequence[str]) -> tuple[str, ...]:
        known = self.workshop.names
        for name in models:
            if name not in known:
                raise SoftprintError(f"there is no model {name!r}; the models are {', '.join(known)}")
        if not 1 <= len(models) <= MOST_MODELS:
            raise SoftprintError(f"one or two models play at a time, not {len(models)}")
        return tuple(models)

    def _drop(self, command: ask.DropCollider) -> None:
        name, density = command.name, command.density
        if name not in self.hands.colliders:
            raise SoftprintError(f"there is no collider {name!r} in the scene")
        free = {k: v for k, v in self._wished[2].items() if k != name}
        if density is not None:
            if not (np.isfinite(density) and density > 0):
                raise SoftprintError(f"a density must be a positive number [kg/m^3], not {density}")
            free[name] = density
        self._free(free)

    def _free(self, free: dict[str, float]) -> None:
        if free != self._wished[2]:
            self._wish(free=free, what="free bodies")

    def _set_shapes(self, tables: tuple[ColliderTable, ...]) -> None:
        names = [table.name for table in tables]
        if not 1 <= len(tables) <= MOST_COLLIDERS or len(set(names)) < len(names) or "" in names:
            raise SoftprintError(
                f"a scene has from one to {MOST_COLLIDERS} colliders, each with its own name"
            )
        free = {name: density for name, density in self._wished[2].items() if name in names}
        self._wish(tables=tables, free=free, what=", ".join(names))

    def _lead_handle(self, command: ask.LeadHandle) -> None:
        if command.displacement is None:
            if self.hands.handles.pop(command.handle, None) is not None:
                self._hold()
            return
        rows = self.players[0].state.rows
        if self.hands.lead_handle(command.handle, command.displacement, command.rotation, rows):
            self._hold()
        self._tell()

    def _set_pace(self, pace: ask.SetPace) -> None:
        if not _SPEEDS[0] <= pace.speed <= _SPEEDS[1]:
            raise SoftprintError(f"the speed is from {_SPEEDS[0]} to {_SPEEDS[1]}, not {pace.speed}")
        own = self.workshop.parts.settings
        limit = own.newton.max_iterations if pace.iterations is None else pace.iterations
        settings = replace(own, newton=replace(own.newton, max_iterations=limit))
        changed = settings != self.settings
        self.pace, self.settings = pace, settings
        if changed:
            self._hold()

    def _record(self, on: bool, film: bool) -> None:
        if not on:
            if self.recording is not None:
                self.recording.film = film
            self._end_recording("")
        elif self.recording is None:
            models = tuple(player.model for player in self.players)
            self.recording = Recording(models, self.tables, dict(self.free), film)
        self._tell()

    # ---- what follows from them -------------------------------------------------------------------------------

    def _wish(
        self,
        models: tuple[str, ...] | None = None,
        tables: tuple[ColliderTable, ...] | None = None,
        free: dict[str, float] | None = None,
        what: str = "",
    ) -> None:
        """Have other models made; what is there plays on meanwhile."""
        before = self._wished
        self._wished = (models or before[0], tables or before[1], before[2] if free is None else free)
        plans = [self._plan(name) for name in self._wished[0]]
        self._builder.ask(plans, what)
        self._tell()

    def _plan(self, model: str) -> Plan:
        tables, free = self.tables, self.free
        if hasattr(self, "_wished"):
            tables, free = self._wished[1], self._wished[2]
        home = self._home()
        poses = {table.name: self._pose_now(table.name, home) for table in tables}
        return Plan(model, tables, dict(free), poses)

    def _put_in_place(self, made: list[Model]) -> None:
        self._end_recording("the recording was ended, because what is in the scene changed")
        before = self.players
        motions_before = before[0].state.motions
        _, self.tables, free = self._wished
        dropped = set(free) - set(self.free)
        self.free = dict(free)
        home = self._home()
        poses = {table.name: self._pose_now(table.name, home) for table in self.tables}
        self.start_poses = {name: self.start_poses.get(name, poses[name]) for name in poses}
        wishes = {name: own.target for name, own in self.hands.colliders.items() if name not in dropped}
        self.hands.place(poses)
        for name, wish in wishes.items():
            if name in self.hands.colliders:
                self.hands.colliders[name].target = wish
        motions = {name: own for name, own in motions_before.items() if name in free}
        self.players = [self._player(model, before[0].state.time, motions, poses) for model in made]
        for number, player in enumerate(self.players):
            player.take_over(before[min(number, len(before) - 1)])
        self._hold()
        for note in dict.fromkeys(player.model.note for player in self.players if player.model.note):
            self._say(note)
        self._tell()

    def _player(
        self,
        model: Model,
        time: float,
        motions: Mapping[str, RigidMotion],
        poses: Mapping[str, RigidPose] | None = None,
    ) -> Player:
        poses = self.start_poses if poses is None else poses
        return Player(model, time, poses, {**self._still(model), **motions})

    def _still(self, model: Model) -> dict[str, RigidMotion]:
        """Free colliders that do not move."""
        return {
            placed.name: RigidMotion(np.zeros(self.body.dim), np.zeros_like(placed.free.motion.momentum))
            for placed in model.simulator.colliders
            if placed.free is not None
        }

    def _pose_now(self, name: str, home: RigidPose) -> RigidPose:
        """Where a collider is: where it has got to, where it is led, or, if it is new, at home."""
        if hasattr(self, "players") and name in self.free and name in self.players[0].state.poses:
            return self.players[0].state.poses[name]
        if name in self.hands.colliders:
            return self.hands.colliders[name].pose
        return home

    def _home(self) -> RigidPose:
        """Where a new collider appears: above the body, beside those that are there."""
        points, size = self.body.mesh.points, self.body.mesh.size
        home = 0.5 * (points.min(axis=0) + points.max(axis=0))
        home[-1] = points[:, -1].max() + 0.5 * size
        home[0] += 0.5 * size * (len(self.hands.colliders) - 1)
        return RigidPose(np.eye(self.body.dim), home)

    def _hold(self) -> None:
        for player in self.players:
            player.hold(self.hands.springs, self.hands.kinematic, self.settings)

    def _follow_free(self) -> None:
        """Followers of free colliders stay with them, so that one can take hold of them; those that have fallen off
        come back."""
        state = self.players[0].state
        centre = self.body.mesh.points.mean(axis=0)
        for name in self.free:
            pose = state.poses[name]
            self.hands.colliders[name].jump(pose)
            if np.linalg.norm(pose.translation - centre) > _FAR * self.body.mesh.size:
                self._say(f"{name} fell off, and is back at its start")
                self.hands.colliders[name].jump(self.start_poses[name])
                for player in self.players:
                    poses = {**player.state.poses, name: self.start_poses[name]}
                    still = {**player.state.motions, name: self._still(player.model)[name]}
                    player.state = replace(player.state, poses=poses, motions=still, contact=None)
                if name not in self.workshop.densities:
                    self._free({k: v for k, v in self._wished[2].items() if k != name})

    def _reset(self) -> None:
        self.hands.place(self.start_poses)
        self.hands.grab = None
        self.hands.handles.clear()
        for player in self.players:
            player.restart(0.0, self.start_poses, self._still(player.model))
        self._end_recording("the recording was ended by the reset")
        self._hold()
        self._tell()

    def _end_recording(self, why: str) -> None:
        ended, self.recording = self.recording, None
        if ended is None:
            return
        if why:
            self._say(why)
        if len(ended.frames) > 1:
            self.finished_recordings.append(ended)
        else:
            self._say("nothing was recorded: no step was taken meanwhile", "bad")

    def _say(self, text: str, kind: str = "info") -> None:
        self._events.append(ask.Notice(text, kind))

    def _tell(self) -> None:
        self._events.append(self.setting())

    @property
    def recordings(self) -> Path:
        """The folder of recordings."""
        return self.workshop.out / FOLDER
