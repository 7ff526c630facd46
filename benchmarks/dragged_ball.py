"""Friction of a ball that is dragged over a block: full space, the bare subspace, and mechanics.

    python -m benchmarks.dragged_ball [--friction 0.3 1 5]

A ball of 30 mm radius is pressed 4 mm into a block of 100 mm, in 2D and 3D, and dragged by 7.2 mm. Printed
are the tangential stiffness over 1.5 mm, while contact sticks, and the sideways force at the end, also relative to full
space, and the error of the force over the drag, sqrt(sum |f - f_full|^2 / sum |f_full|^2).
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence

import numpy as np

from softprint.fem_truth.dynamics.full_space_simulator import FullSpaceSimulator
from softprint.runtime.arrays import Array
from softprint.runtime.body import ReducedBody, assemble_body, frame_in_box, place_handles
from softprint.runtime.cli.script import run_script
from softprint.runtime.colliders import RigidPose, Sphere
from softprint.runtime.contact import CoulombFriction, PenaltyContact
from softprint.runtime.dynamics import (
    DynamicsSettings,
    KinematicHandle,
    NewtonSettings,
    PlacedCollider,
    Simulator,
)
from softprint.runtime.elasticity import make_material
from softprint.runtime.mechanics.body_mechanics import compute_mechanics
from softprint.runtime.mesh import box_mesh

WIDTH, HEIGHT, RADIUS, DEPTH = 0.1, 0.06, 0.03, 0.004  # m
STRIDE, STRIDES = 3e-4, 24  # m a step
SLIP_VELOCITY, TIME_STEP = 1e-3, 0.01  # m/s, s
# Strides between which the tangential stiffness is measured.
FIRST, LAST = 1, 6
DIVISIONS = {2: (40, 24), 3: (18, 18, 11)}
POINTS = {2: 8, 3: 12}


def block(dim: int) -> ReducedBody:
    """A block with its base held."""
    sides = [WIDTH] * (dim - 1)
    mesh = box_mesh([0.0] * dim, [*sides, HEIGHT], DIVISIONS[dim])
    base = frame_in_box(mesh, "base", [[-1.0] * dim, [1.0] * (dim - 1) + [1.1 * HEIGHT / DIVISIONS[dim][-1]]])
    handles = place_handles(mesh, POINTS[dim], [base])
    return assemble_body(mesh, handles, make_material("stable_neo_hookean", 2e4, 0.4), 1000.0, name="block")


def pose(dim: int, depth: float, along: float) -> RigidPose:
    """Of the ball, so deep [m] over the middle of the top, moved along [m]."""
    middle = np.full(dim - 1, 0.5 * WIDTH)
    middle[0] += along
    return RigidPose(np.eye(dim), np.append(middle, HEIGHT + RADIUS - depth))


def dragged(simulator: Simulator | FullSpaceSimulator) -> tuple[Array, int]:
    """The force (STRIDES, dim) [N] on the ball after every stride, and how many steps did not converge."""
    dim = simulator.body.dim
    path = [pose(dim, depth, 0.0) for depth in np.linspace(0.0, DEPTH, 6)]
    path += [pose(dim, DEPTH, STRIDE * stride) for stride in range(1, STRIDES + 1)]
    state = simulator.rest_state(poses={"ball": pose(dim, -0.001, 0.0)})
    forces, failed = [], 0
    for at in path:
        result = simulator.step(state, poses={"ball": at})  # type: ignore[arg-type]
        state, failed = result.state, failed + (not result.converged)
        forces.append(result.contacts["ball"].force)
    return np.array(forces[-STRIDES:]), failed


def compare(dim: int, coefficients: Sequence[float]) -> None:
    """Print the table of one dimension."""
    body = block(dim)
    mechanics = compute_mechanics(body, 2000, condensation=True)
    ball = [PlacedCollider("ball", Sphere(RADIUS, dim, "ball"))]
    options = {
        "contact": PenaltyContact(1e11, 1),
        "kinematic": [KinematicHandle("base")],
        "settings": DynamicsSettings(TIME_STEP, newton=NewtonSettings(40, 1e-5)),
    }
    models: dict[str, Callable[[CoulombFriction], Simulator | FullSpaceSimulator]] = {
        "full": lambda law: FullSpaceSimulator(body, ball, friction=law, **options),  # type: ignore[arg-type]
        "bare": lambda law: Simulator(body, ball, friction=law, **options),  # type: ignore[arg-type]
        "mechanics": lambda law: Simulator(body, ball, friction=law, mechanics=mechanics, **options),  # type: ignore[arg-type]
    }
    for coefficient in coefficients:
        law = CoulombFriction(coefficient, slip_velocity=SLIP_VELOCITY)
        true: Array | None = None
        for name, make in models.items():
            force, failed = dragged(make(law))
            true = force if true is None else true
            stiffness, full = ((f[FIRST, 0] - f[LAST, 0]) / (STRIDE * (LAST - FIRST)) for f in (force, true))
            error = np.linalg.norm(force - true) / np.linalg.norm(true)
            print(
                f"{dim}D  {coefficient:8g}  {name:10s} {stiffness:9.0f} {stiffness / full:6.2f} "
                f"{force[-1, 0] / true[-1, 0]:11.2f} {error:7.1%} {failed:7d}",
                flush=True,
            )


def main() -> None:
    """Compare both dimensions."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--friction", type=float, nargs="+", default=[0.3, 1.0, 5.0], metavar="MU")
    given = parser.parse_args()
    print("     friction  model      N/m       ratio   end ratio   error  failed")
    for dim in (2, 3):
        compare(dim, given.friction)


if __name__ == "__main__":
    run_script(main)
