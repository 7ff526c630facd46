"""A control loop of one's own: press the jelly until it pushes back with 2 N, then hold that force.

    softprint body examples/jelly3d_small.toml && python examples/control_loop.py

The loop owns time and the collider's pose; the simulator only takes steps. Pass a trained correction as
`PlacedCollider(..., correction=load_correction(path, body, pointy))` for detail under the tip.
"""

import sys

import numpy as np

from runtime.body import load_body
from runtime.colliders import RigidPose, Sphere
from runtime.contact import CoulombFriction, PenaltyContact
from runtime.dynamics import DynamicsSettings, KinematicHandle, NewtonSettings, PlacedCollider, Simulator

WANTED = 2.0  # N
GAIN = 2e-4  # m/N a step


def press(body_file: str, steps: int = 240) -> float:
    """Runs the loop; returns the force [N] with which the body pushes back in the end."""
    body = load_body(body_file)
    ball = PlacedCollider("ball", Sphere(0.02, body.dim, "ball"))
    simulator = Simulator(
        body,
        [ball],
        contact=PenaltyContact(1e10),
        friction=CoulombFriction(0.3),
        gravity=[0.0] * (body.dim - 1) + [-9.81],
        kinematic=[KinematicHandle("base")],
        settings=DynamicsSettings(1 / 120, NewtonSettings(max_iterations=2)),
    )
    up = np.eye(body.dim)[-1]
    height = body.mesh.points[:, -1].max() + 0.021

    # The ten lines that matter.
    state = simulator.rest_state(poses={"ball": RigidPose(np.eye(body.dim), height * up)})
    force = 0.0
    for step in range(steps):
        height -= np.clip(GAIN * (WANTED - force), -1e-3, 1e-3)
        result = simulator.step(state, {"ball": RigidPose(np.eye(body.dim), height * up)})
        state = result.state
        force = result.contacts["ball"].force @ up
        if step % 24 == 0:
            print(f"{state.time:5.2f} s  {force:6.3f} N  {1e3 * result.penetration:5.2f} mm  {result.reason}")
    return float(force)


if __name__ == "__main__":
    press(sys.argv[1] if len(sys.argv) > 1 else "runs/jelly3d_small/body.h5")
