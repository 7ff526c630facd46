# %% [markdown]
# # A control loop: hold a force
#
# A ball is pressed into the jelly until the jelly pushes back with 2 N. The loop decides where the ball goes; the
# simulator only takes steps.
#
#     softprint body examples/jelly3d_small.toml && python examples/control_loop.py

# %%
import numpy as np

import softprint

body = softprint.load_body("runs/jelly3d_small/body.h5")
up = np.eye(body.dim)[-1]
top = body.mesh.points[:, -1].max()

# %% [markdown]
# The frame `base` at the bottom is held. The ball has no path, so each step is told where it is. For real time a step
# takes two Newton iterations at most: what is left over is corrected by the next step.

# %%
ball = softprint.PlacedCollider("ball", softprint.colliders.Sphere(0.02, body.dim, "ball"))
simulator = softprint.Simulator(
    body,
    [ball],
    contact=softprint.PenaltyContact(3e11),
    friction=softprint.CoulombFriction(0.3),
    gravity=-9.81 * up,
    kinematic=[softprint.KinematicHandle("base")],
    settings=softprint.DynamicsSettings(1 / 120, softprint.NewtonSettings(max_iterations=2)),
)

# %% [markdown]
# An integral controller: as long as the force is too small, the ball goes down, by 1 mm a step at most.

# %%
target = 2.0  # N
gain = 2e-4  # m/N a step


def pose(height):
    return softprint.RigidPose(np.eye(body.dim), height * up)


height, force = top + 0.021, 0.0
state = simulator.rest_state(poses={"ball": pose(height)})
for step in range(160):
    height -= np.clip(gain * (target - force), -1e-3, 1e-3)
    result = simulator.step(state, {"ball": pose(height)})
    state = result.state
    force = result.contacts["ball"].force @ up
    if step % 16 == 15:
        depth = 1e3 * result.penetration
        print(f"{state.time:5.2f} s  {force:6.3f} N  {depth:5.2f} mm deep  converged: {result.converged}")
