"""Does a reduced step get dearer as the mesh gets finer? It must not: nothing in it has the length of the
mesh.

    python benchmarks/scaling.py

A tapered block of the Jelly's size at about 15,000, 60,000 and 250,000 tetrahedra, the same handles, a cone
pressed into its top with friction. Prints the median time of a step at each size and the ratio of the largest
to the smallest (wanted: below 1.5). Building the finest body takes a minute, most of it the biharmonic basis.
"""

from __future__ import annotations

import argparse
import time

import numpy as np

from runtime.body import ReducedBody, assemble_body, frame_in_box, place_handles
from runtime.colliders import Cone, KeyframedPath
from runtime.contact import CoulombFriction, PenaltyContact
from runtime.dynamics import DynamicsSettings, KinematicHandle, NewtonSettings, PlacedCollider, Simulator
from runtime.elasticity import make_material
from runtime.mesh import Mesh, box_mesh
from runtime.scenes.speed import machine

DIVISIONS = {15_000: (16, 16, 10), 60_000: (26, 26, 15), 250_000: (42, 42, 24)}
HEIGHT = 0.06


def tapered_block(divisions: tuple[int, int, int]) -> Mesh:
    """0.1 m wide at the base, 0.076 m at the top, 0.06 m high."""
    mesh = box_mesh([-0.05, -0.05, 0.0], [0.05, 0.05, HEIGHT], divisions)
    narrowing = 1.0 - 0.24 * mesh.points[:, 2:] / HEIGHT
    return Mesh(mesh.points * np.hstack([narrowing, narrowing, np.ones_like(narrowing)]), mesh.cells)


def make_body(mesh: Mesh) -> ReducedBody:
    """18 points and the base as a frame, as in the thesis."""
    base = frame_in_box(mesh, "base", [[-1.0, -1.0, -1.0], [1.0, 1.0, 0.007]])
    handles = place_handles(mesh, 18, [base])
    return assemble_body(mesh, handles, make_material("stable_neo_hookean", 2e4, 0.4), 1000.0)


def seconds_a_step(body: ReducedBody, iterations: int, steps: int) -> tuple[float, float, int]:
    """Median wall and CPU seconds of a step in contact, and surface samples in contact at the end."""
    cone = Cone([0.0, 0.0, 0.0], [0.0, 0.0, 0.08], 0.008, 0.03, "cone")
    top = HEIGHT + 0.008
    path = KeyframedPath(
        [0.0, 0.2, 0.2 + steps / 60], [[0, 0, top], [0, 0, top - 0.01], [0.02, 0, top - 0.01]]
    )
    simulator = Simulator(
        body,
        [PlacedCollider("cone", cone, path)],
        contact=PenaltyContact(1e10),
        friction=CoulombFriction(0.3),
        gravity=[0.0, 0.0, -9.81],
        kinematic=[KinematicHandle("base")],
        settings=DynamicsSettings(1 / 60, NewtonSettings(max_iterations=iterations, tolerance=1e-12)),
    )
    state, wall, cpu = simulator.settle().state, [], []
    for _ in range(12 + steps):
        began, cpu_began = time.perf_counter(), time.process_time()
        result = simulator.step(state)
        wall.append(time.perf_counter() - began)
        cpu.append(time.process_time() - cpu_began)
        state = result.state
    return float(np.median(wall[12:])), float(np.median(cpu[12:])), result.contacts["cone"].points


def main() -> None:
    """Build, step, print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--iterations", type=int, default=2, help="Newton iterations in every step (default: 2)"
    )
    parser.add_argument("--steps", type=int, default=100, help="steps in contact (default: 100)")
    options = parser.parse_args()
    here = machine()
    print(f"{here['processor']}, threads {here['threads'] or 'not limited'}")
    walls, cpus = [], []
    for divisions in DIVISIONS.values():
        began = time.perf_counter()
        body = make_body(tapered_block(divisions))
        built = time.perf_counter() - began
        wall, cpu, touching = seconds_a_step(body, options.iterations, options.steps)
        walls.append(wall)
        cpus.append(cpu)
        print(
            f"{body.mesh.n_cells:>8} tets  {1e3 * wall:6.2f} ms/step ({1e3 * cpu:.2f} CPU)  "
            f"cubature {len(body.cubature.cells)}, surface {len(body.surface.nodes)}, "
            f"touching {touching}; body built in {built:.0f} s",
            flush=True,
        )
    print(
        f"cost at the finest / at the coarsest: {walls[-1] / walls[0]:.2f}, "
        f"in CPU time {cpus[-1] / cpus[0]:.2f} (wanted: below 1.5)"
    )


if __name__ == "__main__":
    main()
