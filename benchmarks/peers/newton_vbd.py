"""NVIDIA Newton's vertex block descent (Chen et al. 2024), on the CPU.

The collider is a kinematic body; contact is sought at the nodes, edges and triangles of the surface
(`enable_rigid_soft_full_surface_contact`), once a step, and is a penalty at every contact.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from benchmarks.peers.engine import Setting, engine_module, relax, steps_of
from benchmarks.peers.scene import FRAME, Scene
from softprint.runtime.arrays import Array

NAME, PACKAGES = "Newton VBD", "newton==1.8.0 warp-lang==1.19.0"
LAW = "stable neo-Hookean (simplified)"
# m, of every node: contact begins at that distance, and how far beyond it is looked for.
_RADIUS, _GAP = 1e-5, 2e-3
_RECORDS = 4096  # contacts of the collider
EXAMPLES = (10, 10)  # steps a frame and iterations a step, of the soft bodies among Newton's examples


@dataclass(frozen=True)
class Options:
    """stiffness: of every contact [N/m]; Newton's default is 1e3. iterations: of a step."""

    step: float
    iterations: int
    stiffness: float = 1e3


class NewtonVbd:
    """A scene in Newton."""

    def __init__(self, scene: Scene, options: Options) -> None:
        self._warp: Any = engine_module("warp", PACKAGES)
        self._warp.config.log_level = self._warp.LOG_ERROR  # it tells of every kernel
        self._newton: Any = engine_module("newton", PACKAGES)
        self._scene, self._options = scene, options
        model = self._build()
        model.soft_contact_ke, model.soft_contact_kd, model.soft_contact_mu = options.stiffness, 0.0, 0.0
        self._pipeline = self._newton.CollisionPipeline(
            model, soft_contact_gap=_GAP, enable_rigid_soft_full_surface_contact=True
        )
        self._contacts = self._pipeline.contacts()
        self._solver = self._newton.solvers.SolverVBD(
            model,
            iterations=options.iterations,
            particle_enable_self_contact=False,
            particle_enable_tile_solve=False,
            rigid_body_particle_contact_buffer_size=_RECORDS,
        )
        force = self._newton.solvers.SolverBase.ObservableKind.CONTACT_F
        self._observed = self._solver.observables([force], contacts=self._contacts)
        self._now, self._next, self._control = model.state(), model.state(), model.control()

    def settle(self, x: Array) -> None:
        relax(self, self.place, x)

    def advance(self, begin: float, end: float) -> None:
        count = steps_of(self._options.step)
        for step in range(count):
            self._lead(*(begin + (end - begin) * (step + k) / count for k in (0, 1)))
            self._now.clear_forces()
            self._pipeline.collide(self._now, self._contacts)
            observed = {"observables": self._observed} if step == count - 1 else {}
            self._solver.step(
                self._now, self._next, self._control, self._contacts, self._options.step, **observed
            )
            self._now, self._next = self._next, self._now

    def positions(self) -> Array:
        return self._now.particle_q.numpy().astype(float)

    def force(self) -> Array:
        return self._observed.contact_f.numpy()[:, :3].sum(axis=0, dtype=float)

    def _build(self) -> Any:
        warp, newton, scene, own = self._warp, self._newton, self._scene, self._options
        builder = newton.ModelBuilder(gravity=tuple(map(float, scene.gravity)))
        mu, lame = scene.lame
        builder.add_soft_mesh(
            pos=warp.vec3(0.0, 0.0, 0.0),
            rot=warp.quat_identity(),
            scale=1.0,
            vel=warp.vec3(0.0, 0.0, 0.0),
            vertices=[warp.vec3(*point) for point in scene.body.mesh.points],
            indices=scene.body.mesh.cells.ravel().tolist(),
            density=scene.density,
            k_mu=mu,
            k_lambda=lame,
            k_damp=0.0,
            particle_radius=_RADIUS,
        )
        for node in scene.held:
            builder.particle_mass[node] = 0.0  # does not move
        config = newton.ModelBuilder.ShapeConfig(ke=own.stiffness, kd=0.0, mu=0.0)
        led = builder.add_body(xform=warp.transform(*self._transform(0.0)), is_kinematic=True)
        builder.add_shape_sphere(led, radius=scene.collider.radius, cfg=config)
        builder.color()
        return builder.finalize(device="cpu")

    def _transform(self, time: float) -> tuple[Array, Array]:
        """Position and quaternion, the real part last."""
        pose = self._scene.pose(time)
        return pose.translation, Rotation.from_matrix(pose.rotation.copy()).as_quat()

    def _lead(self, begin: float, end: float) -> None:
        (start, turned), (position, quaternion) = self._transform(begin), self._transform(end)
        turn = Rotation.from_quat(quaternion) * Rotation.from_quat(turned).inv()
        velocity = np.concatenate([position - start, turn.as_rotvec()]) / self._options.step
        self._now.body_q.assign(np.concatenate([position, quaternion])[None].astype(np.float32))
        self._now.body_qd.assign(velocity[None].astype(np.float32))

    def place(self, x: Array) -> None:
        """Nodes at x (n_nodes, 3), at rest."""
        self._now.particle_q.assign(x.astype(np.float32))
        self._now.particle_qd.zero_()


def settings() -> Iterator[Setting]:
    """All rows of Newton: its soft bodies come with 10 steps a frame of 1/60 s and 10 iterations a step."""
    for steps, iterations in (
        (1, 10),
        (1, 40),
        (2, 50),
        (5, 10),
        (10, 10),
        (20, 5),
        (4, 50),
        (20, 2),
        (40, 2),
        (40, 5),
    ):
        yield _setting(Options(FRAME / steps, iterations))
    steps, iterations = EXAMPLES
    for stiffness in (1e2, 1e4):
        yield _setting(Options(FRAME / steps, iterations, stiffness))


def _setting(options: Options) -> Setting:
    return Setting(
        NAME,
        LAW,
        f"contact {options.stiffness:g} N/m",
        options.step,
        options.iterations,
        lambda scene: NewtonVbd(scene, options),
    )
