"""Learns how joints settle (`runtime/mechanics/joint_settling.py`) from the states of a truth in internal equilibrium.

With the angles theta_s of the joints, the kernel K_st = k(theta_s, theta_t) and what condensation lacks, e_s, ridge
regression gives the weights alpha = (K + lambda tr(K) / n)^-1 e. The error of each state by the weights of all others
is known without fitting them (the diagonal of the inverse), and lambda is the one with the least. What is learned is
kept where that leaves less than nine tenths of the error of condensation. Where no joint is bent in any of the states,
nothing is learned.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from softprint.runtime.arrays import Array, IntArray
from softprint.runtime.body.body import ReducedBody
from softprint.runtime.mechanics.joint_settling import Joints, JointSettling, kernel
from softprint.runtime.mechanics.static_condensation import StaticCondensation
from softprint.runtime.truth.truth_file import TruthData

_RIDGES = (0.03, 0.1, 0.3, 1.0, 3.0)
_WORTH = 0.9
# Fewer states, or joints that turn less [rad], tell nothing of others.
_FEWEST, _LEAST_TURN = 3, 0.01


class LearnedSettling(NamedTuple):
    """settling: None where it is not worth it; condensation, learned: RMS errors of the displacement inside, over that
    of full space, of each state by the others; states: how many."""

    settling: JointSettling | None
    condensation: float
    learned: float
    states: int


def learn_settling(
    body: ReducedBody, condensation: StaticCondensation, truth: TruthData, states: IntArray
) -> LearnedSettling | None:
    """From some states of a truth. condensation: of all nodes of the body. None for a body without joints, or too few
    states."""
    joints = Joints.of(body)
    if not len(joints.pairs) or len(states) < _FEWEST:
        return None
    rows = truth.states["rows"][states]
    internal = np.stack([truth.internal(state) for state in states])
    return fitted(joints, condensation, rows, internal, body.node_mass)


def fitted(
    joints: Joints, condensation: StaticCondensation, rows: Array, internal: Array, mass: Array
) -> LearnedSettling:
    """From handle rows (s, n_rows, dim) and displacements in equilibrium (s, n, dim) of nodes with masses (n,)."""
    missed = np.stack([_missed(condensation, *state) for state in zip(rows, internal, strict=True)])
    n, weight = len(rows), np.sqrt(mass)[:, None]
    theta = np.stack([joints.angles(own) for own in rows])
    size = float(np.linalg.norm(weight * internal)) or 1.0
    before = float(np.linalg.norm(weight * missed)) / size
    if np.abs(theta).max() < _LEAST_TURN:
        return LearnedSettling(None, before, before, n)
    K = kernel(theta, theta)
    found = [_by_others(K, ridge, missed.reshape(n, -1)) for ridge in _RIDGES]
    errors = [float(np.linalg.norm(weight * error.reshape(missed.shape))) / size for _, error in found]
    best = int(np.argmin(errors))
    if errors[best] > _WORTH * before:
        return LearnedSettling(None, before, before, n)
    alpha = found[best][0].reshape(missed.shape).transpose(1, 2, 0).astype(np.float32)
    return LearnedSettling(JointSettling(joints, theta, np.ascontiguousarray(alpha)), before, errors[best], n)


def _missed(condensation: StaticCondensation, rows: Array, internal: Array) -> Array:
    """e (n, dim)."""
    own = condensation.corotated(rows)
    return np.asarray((own.rotations.swapaxes(1, 2) @ (internal - own.displacement(rows))[..., None])[..., 0])


def _by_others(K: Array, ridge: float, missed: Array) -> tuple[Array, Array]:
    """The weights (s, v), and the error of every state by those of the others (s, v)."""
    inverse = np.linalg.inv(K + ridge * np.trace(K) / len(K) * np.eye(len(K)))
    weights = inverse @ missed
    return weights, weights / np.diag(inverse)[:, None]


def told(found: LearnedSettling) -> str:
    """What was found, in a sentence."""
    if found.settling is None:
        return f"settling of joints: static condensation, {found.condensation:.1%} off at {found.states} states"
    return (
        f"settling of joints: learned from {found.states} states; each by the others {found.condensation:.1%} -> "
        f"{found.learned:.1%}"
    )

