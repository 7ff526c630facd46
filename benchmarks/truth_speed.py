"""The cost and the accuracy of full-space solves: a truth sample, and a step of full-space dynamics.

    python -m benchmarks.truth_speed [examples/jelly3d.toml] [--contacts 4] [--steps 20]

States are taken from the experiment's first recorded scene, played by the bare reduced model; contacts are
places on the surface with random rotations, pressed from shallow to deep as `softprint generate` does. Errors
are relative L2 norms of the contact displacement against the same solve converged to 1e-8.
"""

from __future__ import annotations

import argparse
import os
import platform
import resource
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from benchmarks.stopwatch import Stopwatch
from softprint.fem_truth.dynamics.full_space_model import scene_simulator
from softprint.fem_truth.elasticity.full_space_elasticity import FullSpaceElasticity
from softprint.fem_truth.linalg.null_space import NullSpace
from softprint.fem_truth.statics.constrained import ConstrainedProblem, Solution
from softprint.fem_truth.statics.newton import FullSpaceSettings
from softprint.runtime.arrays import Array
from softprint.runtime.body.build import build_body
from softprint.runtime.cli.script import run_script
from softprint.runtime.colliders.approach import Approach
from softprint.runtime.colliders.build import build_collider
from softprint.runtime.contact import PenaltyContact
from softprint.runtime.experiment import load_experiment
from softprint.runtime.optimise import NewtonSettings
from softprint.runtime.scenes.playing import bare_model
from softprint.runtime.scenes.scene import scene_parts

DEFAULT = Path(__file__).parent.parent / "examples" / "jelly3d.toml"
TIGHT = FullSpaceSettings(NewtonSettings(60, 1e-8), 1e-13, cg_tolerance_min=1e-5)


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("experiment", type=Path, nargs="?", default=DEFAULT, help="default: %(default)s")
    parser.add_argument("--contacts", type=int, default=4, help="how many to press (default: 4)")
    parser.add_argument("--steps", type=int, default=20, help="steps of dynamics, 0 for none (default: 20)")
    parser.add_argument("--begin", type=float, default=0.3, help="of dynamics [s] (default: 0.3)")
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()

    experiment = load_experiment(arguments.experiment)
    body = build_body(experiment.body, experiment.base_dir)
    threads = os.environ.get("OMP_NUM_THREADS", "not set")
    print(f"{platform.processor() or platform.machine()}, {os.cpu_count()} cores, OMP_NUM_THREADS {threads}")
    print(f"{body.name}: {body.mesh.n_cells} cells, {body.n_nodes} nodes, {body.n_rows} handle rows")

    elasticity = FullSpaceElasticity(body)
    print_kernels(elasticity, body.mesh.points)
    contact = PenaltyContact.of(experiment.contact)
    problem = ConstrainedProblem(elasticity, np.array(experiment.dynamics.gravity), contact, body)
    collider = build_collider(experiment.collider(experiment.sampling.collider), experiment.base_dir)
    scene = next(scene for scene in experiment.scenes if scene.role == "record")
    rng = np.random.default_rng(arguments.seed)
    depths = np.linspace(0, experiment.sampling.max_depth, experiment.sampling.depths + 1)[1:]

    watch = Stopwatch()
    watch.watch(elasticity, "hessian", "assemble Hessian")
    watch.watch(elasticity, "energy_gradient", "energy and gradient")
    watch.watch(elasticity, "min_det_F", "det F")
    samples: list[tuple[Solution, float, float, float]] = []
    for number, rows in enumerate(recorded_states(experiment, body, scene, arguments.contacts)):
        internal = problem.internal_equilibrium(rows)
        print(
            f"state {number}: {internal.status.name}, {internal.newton_iterations} Newton, "
            f"{internal.cg_iterations} CG, {internal.seconds:.2f} s, lowest Ritz value "
            f"{internal.min_eigenvalue:.4f}, min det F {internal.min_det_F:.2f}"
        )
        approach = random_approach(body, internal.x, collider, rng)
        poses = approach.poses_at(depths)
        watch.seconds.clear()
        start = time.process_time()
        press = problem.press(rows, collider, internal.x)
        solutions = [press.solve(pose) for pose in poses]
        total = time.process_time() - start
        split = ", ".join(f"{label} {seconds:.2f}" for label, seconds in watch.seconds.items())
        print(f"  {total:.2f} CPU s for {len(poses)} depths; of these {split}; the rest is CG and contact")
        for depth, pose, solution in zip(depths, poses, solutions, strict=True):
            exact = problem.solve(rows, collider, pose, solution.x, TIGHT, internal.x).x - internal.x
            linear = problem.linear_response(rows, collider, pose, internal.x).x - internal.x
            error, baseline = (
                float(np.linalg.norm(u - exact) / np.linalg.norm(exact))
                for u in (solution.x - internal.x, linear)
            )
            samples.append((solution, error, baseline, total / len(poses)))
            print(
                f"  depth {1e3 * depth:5.2f} mm: {solution.status.name}, "
                f"{solution.newton_iterations:2d} Newton, {solution.cg_iterations:3d} CG, "
                f"{solution.seconds:.2f} s, residual {solution.residual:.0e}, "
                f"decrement {solution.decrement:.0e}, "
                f"max |u| {1e3 * np.linalg.norm(exact, axis=1).max():.1f} mm, "
                f"error {error:.1e}, linear response {baseline:.2f}"
            )
    seconds, errors = np.array([sample[3] for sample in samples]), np.array([sample[1] for sample in samples])
    converged = sum(sample[0].converged for sample in samples)
    print(
        f"a sample: {seconds.mean():.2f} core-seconds; {converged} of {len(samples)} converged; error median "
        f"{np.median(errors):.1e}, largest {errors.max():.1e}"
    )
    if arguments.steps:
        print_dynamics(experiment, body, elasticity, arguments.steps, arguments.begin)
    print(f"peak memory {resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20:.2f} GiB")


def print_kernels(elasticity: FullSpaceElasticity, x: Array) -> None:
    """Best of five for each building block."""
    matrix, vector = elasticity.hessian(x), np.random.default_rng(0).standard_normal(x.shape)
    null_space = NullSpace(np.random.default_rng(0).standard_normal((len(x), 22)), np.arange(0))
    kernels = {
        "energy": lambda: elasticity.energy(x),
        "energy and gradient": lambda: elasticity.energy_gradient(x),
        "Hessian": lambda: elasticity.hessian(x),
        "matrix product in double precision": lambda: matrix.apply(vector),
        "projection (22 columns)": lambda: null_space.project(x),
    }
    print("; ".join(f"{name} {1e3 * best_of(5, call):.2f} ms" for name, call in kernels.items()))


def best_of(count: int, call: Callable[[], Any]) -> float:
    best = np.inf
    for _ in range(count):
        start = time.process_time()
        call()
        best = min(best, time.process_time() - start)
    return best


def recorded_states(experiment: Any, body: Any, scene: Any, count: int) -> list[Array]:
    """Handle rows at evenly spaced times of the scene, played by the bare subspace."""
    model = bare_model(experiment, body, scene)
    steps = round(scene.duration / experiment.dynamics.time_step)
    wanted = set(np.linspace(0.3 * steps, steps - 1, count).astype(int).tolist())
    state, states = model.start().state, []
    for step in range(steps):
        state = model.step(state).state
        if step in wanted:
            states.append(state.rows)
    return states


def random_approach(body: Any, x: Array, collider: Any, rng: np.random.Generator) -> Approach:
    """A line along the normal of a random place on the upper surface."""
    mesh = body.mesh
    high = np.flatnonzero(mesh.points[mesh.surface_nodes, -1] > 0.4 * mesh.points[:, -1].max())
    place = int(rng.choice(high))
    if body.dim == 3:
        rotation = Rotation.random(random_state=rng).as_matrix()
    else:
        angle = rng.uniform(0, 2 * np.pi)
        rotation = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    node = mesh.surface_nodes[place]
    return Approach(collider, x[mesh.surface_nodes], x[node], mesh.surface_normals[place], rotation)


def print_dynamics(
    experiment: Any, body: Any, elasticity: FullSpaceElasticity, steps: int, begin: float
) -> None:
    """The held-out scene in full space: to convergence, and with one Newton iteration a step."""
    parts = scene_parts(experiment, next(scene for scene in experiment.scenes if scene.role == "test"))
    for iterations in (parts.settings.newton.max_iterations, 1):
        newton = replace(parts.settings.newton, max_iterations=iterations)
        limited = replace(parts, settings=replace(parts.settings, newton=newton))
        simulator = scene_simulator(limited, body, elasticity)
        state = simulator.settle(simulator.rest_state(begin)).state
        seconds, results = [], []
        for _ in range(steps):
            start = time.process_time()
            results.append(simulator.step(state))
            seconds.append(time.process_time() - start)
            state = results[-1].state
        touching = np.array([result.penetration > 0 for result in results])
        print(
            f"full-space step, at most {iterations} iterations: {1e3 * np.mean(seconds):.0f} ms, in contact "
            f"{1e3 * np.mean(np.array(seconds)[touching]):.0f} ms ({touching.sum()} of {steps} steps), "
            f"{np.mean([result.iterations for result in results]):.1f} iterations, "
            f"{sum(result.converged for result in results)} converged"
        )


if __name__ == "__main__":
    run_script(main)
