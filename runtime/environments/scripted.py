"""Policies that solve the tasks from their observations alone: each is a function of one observation, which returns an
action."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from softprint.runtime.environments.find_edge import FindEdgeEnv
from softprint.runtime.environments.press_to_force import PressToForceEnv
from softprint.runtime.environments.tactile_environment import MILLIMETRES, Observation, TactileEnv

_CAUTIOUS = 0.7  # of the way to the goal in one action
_INDENTED = 0.35  # mm, how deep the block is pressed to find its edge
_IN_CONTACT = 0.75  # of the largest depth: where the block is


def press_to_force(env: PressToForceEnv, seen: Observation) -> NDArray[np.float32]:
    """Down until there is a force, and then by the stiffness of a Hertzian contact, 3/2 F / depth. Needs the force."""
    force, wanted = float(np.linalg.norm(seen["force"])), float(seen["target"][0])
    depth = MILLIMETRES * env.radius - float(seen["indenter"][2])
    if force < 1e-3 or depth < 0.02:
        down = -0.1
    else:
        down = _CAUTIOUS * (force - wanted) / max(1.5 * force / depth, 0.1)
    return _action(env, np.array([0.0, 0.0, np.clip(down, -0.15, 0.15)]))


def find_edge(env: FindEdgeEnv, seen: Observation) -> NDArray[np.float32]:
    """Down to a given depth, and then sideways by the way from the nearest place on the edge of what is pressed in to
    the middle of the image. It needs the depth image."""
    height = float(seen["indenter"][2])
    down = MILLIMETRES * env.half_extents[2] - _INDENTED - height
    depth = seen["depth"]
    move = np.array([0.0, 0.0, np.clip(down, -0.3, 0.3)])
    if depth.max() > 0.5 * _INDENTED:
        move[:2] = -_CAUTIOUS * nearest_edge(
            depth > _IN_CONTACT * depth.max(), MILLIMETRES * env.pad.camera.field
        )
    return _action(env, move)


def nearest_edge(pressed: NDArray[np.bool_], field: NDArray[np.float64]) -> NDArray[np.float64]:
    """(2,) the place in the plane, nearest to the middle, where an image (rows, columns) of a field of view changes."""
    rows, columns = pressed.shape
    pixel = field / [columns, rows]
    across = np.argwhere(pressed[:, 1:] != pressed[:, :-1]) + np.array([0.0, 0.5])
    up = np.argwhere(pressed[1:] != pressed[:-1]) + np.array([0.5, 0.0])
    edges = np.concatenate([across, up])
    if not len(edges):
        return np.zeros(2)
    places = np.column_stack(
        [(edges[:, 1] - 0.5 * (columns - 1)) * pixel[0], -(edges[:, 0] - 0.5 * (rows - 1)) * pixel[1]]
    )
    return np.asarray(places[np.argmin(np.square(places).sum(axis=1))])


def _action(env: TactileEnv, move: NDArray[np.float64]) -> NDArray[np.float32]:
    """That moves the indenter by so much [mm], as far as one action can."""
    longest = MILLIMETRES * env.speed * env.repeat * env.pad.time_step
    return np.clip(move / longest, -1.0, 1.0).astype(np.float32)
