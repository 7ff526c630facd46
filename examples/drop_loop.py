"""A loop of one's own over colliders that move freely: drop a ball, and kick it up whenever it has come to rest.

    softprint body examples/jelly3d_small.toml && python examples/drop_loop.py

States are plain values: what is to happen to a collider between two steps is a new state with another motion.
"""

import sys
from dataclasses import replace

import numpy as np

from runtime.body import load_body
from runtime.colliders import RigidPose, Sphere
from runtime.contact import CoulombFriction, PenaltyContact
from runtime.dynamics import DynamicsSettings, KinematicHandle, NewtonSettings, PlacedCollider, Simulator
from runtime.rigid import free_collider

KICK = 0.8  # m/s


def bounce(body_file: str, steps: int = 180) -> int:
    """Runs the loop; returns how many times the ball was kicked."""
    body = load_body(body_file)
    up, ball = np.eye(body.dim)[-1], Sphere(0.015, body.dim, "ball")
    above = RigidPose(np.eye(body.dim), (body.mesh.points[:, -1].max() + 0.03) * up)
    simulator = Simulator(
        body,
        [PlacedCollider("ball", ball, free=free_collider(ball, above, density=2000.0))],
        contact=PenaltyContact(1e10),
        friction=CoulombFriction(0.3),
        gravity=-9.81 * up,
        kinematic=[KinematicHandle("base")],
        settings=DynamicsSettings(1 / 60, NewtonSettings(max_iterations=40)),
    )

    # The ten lines that matter.
    state, kicks = simulator.settle().state, 0
    for step in range(steps):
        result = simulator.step(state)
        state, motion = result.state, result.state.motions["ball"]
        if result.contacts["ball"].points and np.linalg.norm(motion.velocity) < 5e-3:
            state = replace(state, motions={"ball": replace(motion, velocity=KICK * up)})
            kicks += 1
        if step % 12 == 0:
            force, height = result.contacts["ball"].force @ up, state.poses["ball"].translation @ up
            print(f"{state.time:5.2f} s  {1e3 * height:6.1f} mm  {force:6.3f} N  {result.reason}")
    return kicks


if __name__ == "__main__":
    bounce(sys.argv[1] if len(sys.argv) > 1 else "runs/jelly3d_small/body.h5")
