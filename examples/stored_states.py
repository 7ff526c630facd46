# %% [markdown]
# # Stored states: save a simulation, branch it, replay it
#
# A step is a function of its arguments: everything that it remembers is in the state. So a state can be saved, loaded
# in another process, continued in two ways, and replayed with the same bits.
#
#     softprint body examples/jelly3d_small.toml && python examples/stored_states.py

# %%
from pathlib import Path

import numpy as np

import softprint

body = softprint.load_body("runs/jelly3d_small/body.h5")
along, up = np.eye(body.dim)[0], np.eye(body.dim)[-1]
top = body.mesh.points[:, -1].max()

ball = softprint.PlacedCollider("ball", softprint.colliders.Sphere(0.02, body.dim, "ball"))
simulator = softprint.Simulator(
    body,
    [ball],
    contact=softprint.PenaltyContact(3e11),
    friction=softprint.CoulombFriction(0.3),
    gravity=-9.81 * up,
    kinematic=[softprint.KinematicHandle("base")],
)


def pose(down, aside):
    return softprint.RigidPose(np.eye(body.dim), (top + 0.021 - down) * up + aside * along)


# %% [markdown]
# Press the ball in by 5 mm and save the state.

# %%
state = simulator.settle(simulator.rest_state(poses={"ball": pose(0.0, 0.0)})).state
for down in np.linspace(0.0, 6e-3, 31):
    state = simulator.step(state, {"ball": pose(down, 0.0)}).state

file = Path("runs/jelly3d_small/pressed.h5")
softprint.save_state(file, state)
print(f"saved at {state.time:.2f} s, {file.stat().st_size / 1024:.0f} kB; see `softprint inspect {file}`")

# %% [markdown]
# From the stored state the motion branches: one ball is lifted, the other dragged along.


# %%
def play(state, poses):
    for end in poses:
        result = simulator.step(state, {"ball": end})
        state = result.state
    return result


stored = softprint.load_state(file)
lifted = play(stored, [pose(down, 0.0) for down in np.linspace(6e-3, 0.0, 30)])
dragged = play(stored, [pose(6e-3, aside) for aside in np.linspace(0.0, 0.01, 30)])
for name, result in (("lifted", lifted), ("dragged", dragged)):
    print(f"{name:8s} {result.contacts['ball'].force.round(3)} N after {result.state.time:.2f} s")

# %% [markdown]
# A replay gives the same bits, whatever the simulator has done in between, and from the state in memory as from the
# one in the file.

# %%
replay = play(state, [pose(6e-3, aside) for aside in np.linspace(0.0, 0.01, 30)])
same = np.array_equal(replay.state.rows, dragged.state.rows)
print("the replay has the same bits" if same else "the replay differs")
