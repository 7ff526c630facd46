# %% [markdown]
# # Free rigid bodies: drop a ball, and kick it
#
# A ball falls on the jelly and is stepped together with it. Whenever it has come to rest, it gets a new velocity.
#
#     softprint body examples/jelly3d_small.toml && python examples/drop_loop.py

# %%
from dataclasses import replace

import numpy as np

import softprint

body = softprint.load_body("runs/jelly3d_small/body.h5")
up = np.eye(body.dim)[-1]
top = body.mesh.points[:, -1].max()

# %% [markdown]
# A collider with a mass moves freely. It starts 3 cm above the jelly, measured to its centre.

# %%
ball = softprint.colliders.Sphere(0.015, body.dim, "ball")
start = softprint.RigidPose(np.eye(body.dim), (top + 0.03) * up)
simulator = softprint.Simulator(
    body,
    [softprint.PlacedCollider("ball", ball, free=softprint.free_collider(ball, start, density=2000.0))],
    contact=softprint.PenaltyContact(1e10),  # soft, so that the ball soon comes to rest
    friction=softprint.CoulombFriction(0.3),
    gravity=-9.81 * up,
    kinematic=[softprint.KinematicHandle("base")],
    settings=softprint.DynamicsSettings(1 / 60, softprint.NewtonSettings(max_iterations=40)),
)

# %% [markdown]
# States are plain values that are never changed. So a kick is a new state with another velocity of the ball.

# %%
kick = 0.8  # m/s
kicks = 0
state = simulator.settle().state
for step in range(120):
    result = simulator.step(state)
    state, contact = result.state, result.contacts["ball"]
    motion = state.motions["ball"]
    if contact.points and np.linalg.norm(motion.velocity) < 5e-3:
        state = replace(state, motions={"ball": replace(motion, velocity=kick * up)})
        kicks += 1
    if step % 10 == 9:
        height = state.poses["ball"].translation @ up
        force = contact.force @ up
        print(f"{state.time:5.2f} s  {1e3 * height:6.1f} mm  {force:6.3f} N  converged: {result.converged}")
print(f"kicked {kicks} times")
