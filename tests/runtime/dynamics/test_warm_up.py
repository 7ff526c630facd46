"""After `softprint.warm_up()` a simulation compiles nothing."""

from __future__ import annotations

import subprocess
import sys

import pytest

from tests.conftest import REPOSITORY

# Bodies, shapes and numbers of contact nodes other than those of the warm-up; friction, a led and a free collider.
_PLAY = """
import sys
import numpy as np
import softprint
from numba.core.dispatcher import Dispatcher
from softprint.runtime.rigid import free_collider
from softprint.runtime.scenes.warm_up import n_scenes
from tests.conftest import _jelly

def kernels():
    return {
        (name, key): set(value.signatures)
        for name, module in list(sys.modules.items()) if name.startswith("softprint.")
        for key, value in vars(module).items() if isinstance(value, Dispatcher)
    }

dim = int(sys.argv[1])
body = _jelly([-0.05] * (dim - 1) + [0.0], [0.05] * (dim - 1) + [0.06], [6] * dim, 6)
mechanics = softprint.compute_mechanics(body, 80, True)
def play(mechanics, refinement):
    ball, pear = (softprint.colliders.Sphere(0.012, dim, name) for name in ("ball", "pear"))
    above = np.append(np.zeros(dim - 1), 0.073)
    path = softprint.KeyframedPath([0.0, 0.1, 0.3], [above, above - np.eye(dim)[-1] * 4e-3, above - 3e-3])
    beside = softprint.RigidPose(np.eye(dim), np.append(np.full(dim - 1, 0.03), 0.0721))
    placed = [
        softprint.PlacedCollider("ball", ball, path),
        softprint.PlacedCollider("pear", pear, free=free_collider(pear, beside, density=500.0)),
    ]
    simulator = softprint.Simulator(
        body, placed, contact=softprint.PenaltyContact(1e10, refinement), mechanics=mechanics,
        friction=softprint.CoulombFriction(0.3), gravity=[0.0] * (dim - 1) + [-9.81],
        kinematic=[softprint.KinematicHandle("base")],
    )
    state = simulator.settle().state
    deepest = 0.0
    for _ in range(10):
        result = simulator.step(state)
        state, deepest = result.state, max(deepest, result.penetration)
        simulator.surface_positions(state)
    assert deepest > 0

played = []
softprint.warm_up((dim,), played.append)
assert sum(played) == n_scenes((dim,))
warm = kernels()
assert sum(map(len, warm.values())) > 30
for refinement in (0, 1):
    play(None, refinement)
    play(mechanics, refinement)
late = {key: found - warm.get(key, set()) for key, found in kernels().items()}
print(*(key for key, found in late.items() if found), sep="\\n")
"""


@pytest.mark.slow
def test_a_simulation_compiles_nothing_after_the_warm_up(dim: int):
    done = subprocess.run(
        [sys.executable, "-c", _PLAY, str(dim)], cwd=REPOSITORY, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.split("\n") == ["", ""], done.stdout
