"""What a fingertip's nerves would report, in a control loop: pressure, shear and strain at three points, step by step.

    softprint body examples/jelly3d_small.toml && python examples/touch_loop.py

A ball is pressed into the jelly and dragged sideways. `softprint touch` does the same for a scene of an experiment, and
writes time series.
"""

import sys

import numpy as np

from runtime.body import load_body
from runtime.colliders import RigidPose, Sphere
from runtime.contact import CoulombFriction, PenaltyContact
from runtime.dynamics import KinematicHandle, PlacedCollider, Simulator
from runtime.touch import Touch, TouchSensor, point_places


def drag(body_file: str, steps: int = 120) -> Touch:
    """Runs the loop; returns what is felt in the end."""
    body = load_body(body_file)
    ball = PlacedCollider("ball", Sphere(0.02, body.dim, "ball"))
    contact, friction, held = PenaltyContact(1e10), CoulombFriction(0.5), KinematicHandle("base")
    simulator = Simulator(body, [ball], contact=contact, friction=friction, kinematic=[held])
    along, up = np.eye(body.dim)[0], np.eye(body.dim)[-1]
    top = body.mesh.points[:, -1].max()

    # The ten lines that matter.
    points = {name: x * along + top * up for name, x in (("left", -0.01), ("middle", 0.0), ("right", 0.01))}
    sensor = TouchSensor(simulator, body, point_places(body, points))
    state = simulator.rest_state(poses={"ball": RigidPose(np.eye(body.dim), (top + 0.021) * up)})
    for step in range(steps):
        centre = (top + 0.021 - 1e-4 * min(step, 60)) * up + 1e-4 * max(step - 60, 0) * along
        result = simulator.step(state, {"ball": RigidPose(np.eye(body.dim), centre)})
        state = result.state
        felt = sensor.feel(result)
        if step % 12 == 11:
            print(
                f"{felt.time:5.2f} s  pressure {felt.pressure.round()} Pa  strain {felt.strain_norm.round(3)}"
            )
    return felt


if __name__ == "__main__":
    drag(sys.argv[1] if len(sys.argv) > 1 else "runs/jelly3d_small/body.h5")
