# %% [markdown]
# # Touch: what a fingertip's nerves would report
#
# Pressure and strain at three points of the skin, step by step, while a ball is pressed into the jelly and dragged
# sideways. `softprint touch` does the same for a scene of an experiment and writes time series.
#
#     softprint body examples/jelly3d_small.toml && python examples/touch_loop.py

# %%
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
    friction=softprint.CoulombFriction(0.5),
    kinematic=[softprint.KinematicHandle("base")],
)

# %% [markdown]
# The points are given by where they are on the undeformed body. A sensor costs less than a millisecond a step,
# whatever the size of the mesh.

# %%
points = {"left": top * up - 0.01 * along, "middle": top * up, "right": top * up + 0.01 * along}
sensor = softprint.TouchSensor(simulator, body, softprint.point_places(body, points))

# %% [markdown]
# Half of the steps press the ball in, by 6 mm; the other half drag it along.


# %%
def pose(step):
    height = top + 0.021 - 1e-4 * min(step, 60)
    return softprint.RigidPose(np.eye(body.dim), height * up + 1e-4 * max(step - 60, 0) * along)


state = simulator.rest_state(poses={"ball": pose(0)})
for step in range(120):
    result = simulator.step(state, {"ball": pose(step)})
    state = result.state
    touch = sensor.feel(result)
    if step % 12 == 11:
        pressure, shear = 1e-3 * touch.pressure, 1e-3 * touch.traction @ along
        print(
            f"{touch.time:5.2f} s  pressure {pressure.round(1)} kPa  shear {shear.round(1)} kPa  "
            f"strain {touch.strain_norm.round(3)}"
        )
