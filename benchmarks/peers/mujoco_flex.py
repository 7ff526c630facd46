"""MuJoCo's flex, in two forms: with a body of three slide joints at every node that is not held; and with such bodies
at the nodes of a grid of cells instead (`dof="trilinear"` or `"quadratic"`), which its documentation prefers where the
deformation allows it. The tetrahedra collide in both.

The integrator is `discrete`, which is implicit in the elastic forces: `implicit` and `implicitfast` refuse them. The
collider is a heavy body with a free joint whose pose and velocity are set before every step, so that contact knows how
fast it moves.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from benchmarks.peers.engine import Setting, engine_module, relax, steps_of
from benchmarks.peers.scene import FRAME, Scene
from softprint.runtime.arrays import Array, IntArray

NAME, CELLS, PACKAGES = "MuJoCo flex", "MuJoCo flex, cells", "mujoco-core==4.0.0"
# solref and solimp. Of the flex models that come with MuJoCo (model/flex), and two that give way less.
CONTACTS = {
    "as in its models": ((0.01, 1.0), (0.95, 0.99, 1e-4, 0.5, 2.0)),
    "firm": ((0.02, 1.0), (0.999, 0.9999, 1e-3, 0.5, 2.0)),
    "stiff": ((0.01, 1.0), (0.9999, 0.9999, 1e-3, 0.5, 2.0)),
}
LAWS = ("St Venant-Kirchhoff", "stable neo-Hookean (simplified)")
OF_CELLS = "linear, corotated cells"
_LED = 100.0  # kg, of the collider
_MEMORY = 2 * 10**9  # bytes
_SETTLED = 60  # frames in which cells come to rest, which cannot be put where full space is


@dataclass(frozen=True)
class Options:
    """law: of `LAWS`; contact: of `CONTACTS`; solver, tolerance, iterations: of MuJoCo; cells: of the grid along x, y
    and z, with the order of its interpolation, without which every node is free."""

    step: float
    law: int = 1
    contact: str = "stiff"
    solver: str = "CG"
    tolerance: float = 1e-6
    iterations: int = 100
    cells: tuple[int, int, int] | None = None
    order: int = 1


class MujocoFlex:
    """A scene in MuJoCo, with a free body at every node that is not held."""

    def __init__(self, scene: Scene, options: Options) -> None:
        mujoco = engine_module("mujoco", PACKAGES)
        self._mujoco, self._scene, self._options = mujoco, scene, options
        self._free, self._rest = scene.free, scene.body.mesh.points
        spec = self._spec()
        self._add_collider(spec)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # about elasticity that is not in a MJCF file
            self._model = spec.compile()
        # A tolerance is relative to the mean inertia of all bodies: without the collider's.
        self._model.stat.meaninertia = float(np.median(scene.body.node_mass[self._free]))
        self._data = mujoco.MjData(self._model)

    def settle(self, x: Array) -> None:
        relax(self, self.place, x)

    def place(self, x: Array) -> None:
        """Nodes at x (n_nodes, 3), at rest."""
        self._data.qpos[:-7] = (x - self._rest)[self._free].ravel()
        self._data.qvel[:] = 0.0

    def advance(self, begin: float, end: float) -> None:
        count = steps_of(self._options.step)
        for step in range(count):
            at, then = (begin + (end - begin) * (step + k) / count for k in (0, 1))
            self._lead(at, then)
            self._mujoco.mj_step(self._model, self._data)

    def positions(self) -> Array:
        x = self._rest.copy()
        x[self._free] += self._data.qpos[:-7].reshape(-1, 3)
        return x

    def force(self) -> Array:
        contact = self._data.contact
        rows = contact.efc_address
        bearing = rows >= 0
        pushed = self._data.efc_force[rows[bearing]]
        # The normal points from the first of a contact to the second.
        first = np.where(contact.geom[bearing, 0] >= 0, -1.0, 1.0)
        return np.asarray((first * pushed) @ contact.frame[bearing, :3])

    def _spec(self) -> Any:
        """The body, without the collider."""
        mujoco, scene, own = self._mujoco, self._scene, self._options
        spec = mujoco.MjSpec()
        self._set_options(spec)
        names = ["world"] * scene.body.n_nodes
        for node in self._free:
            names[node] = f"node{node}"
            body = spec.worldbody.add_body(name=names[node], pos=self._rest[node])
            body.mass, body.inertia, body.explicitinertial = scene.body.node_mass[node], [1e-9] * 3, True
            for axis in np.eye(3):
                body.add_joint(type=mujoco.mjtJoint.mjJNT_SLIDE, axis=axis)
        fixed = np.zeros_like(self._rest)
        fixed[scene.held] = self._rest[scene.held]
        flex = spec.add_flex(name="body", dim=3, radius=0.0)
        flex.elastic3d = own.law
        flex.vertbody, flex.vert = names, fixed.ravel().tolist()
        flex.elem = scene.body.mesh.cells.ravel().tolist()
        self._set_material(flex)
        return spec

    def _set_options(self, spec: Any) -> None:
        mujoco, own = self._mujoco, self._options
        spec.memory = _MEMORY
        spec.option.timestep = own.step
        spec.option.integrator = mujoco.mjtIntegrator.mjINT_DISCRETE
        spec.option.solver = getattr(mujoco.mjtSolver, f"mjSOL_{own.solver.upper()}")
        spec.option.tolerance, spec.option.iterations = own.tolerance, own.iterations
        spec.option.gravity = self._scene.gravity

    def _set_material(self, flex: Any) -> None:
        flex.young, flex.poisson = self._scene.elastic
        flex.damping = 0.0
        flex.selfcollide = self._mujoco.mjtFlexSelf.mjFLEXSELF_NONE
        flex.contype = flex.conaffinity = flex.condim = flex.priority = 1
        flex.solref, flex.solimp = CONTACTS[self._options.contact]

    def _add_collider(self, spec: Any) -> None:
        led = spec.worldbody.add_body(name="collider", pos=self._scene.pose(0.0).translation)
        led.add_freejoint()
        led.mass, led.inertia, led.explicitinertial, led.gravcomp = _LED, [0.1 * _LED] * 3, True, 1.0
        led.add_geom(
            type=self._mujoco.mjtGeom.mjGEOM_SPHERE,
            size=[self._scene.collider.radius, 0.0, 0.0],
            contype=1,
            conaffinity=1,
            condim=1,
            mass=0.0,
        )

    def _lead(self, begin: float, end: float) -> None:
        pose, then, h = self._scene.pose(begin), self._scene.pose(end), self._options.step
        turn = Rotation.from_matrix(pose.rotation.T @ then.rotation).as_rotvec()
        x, y, z, w = Rotation.from_matrix(pose.rotation.copy()).as_quat()
        self._data.qpos[-7:] = [*pose.translation, w, x, y, z]
        self._data.qvel[-6:] = [*(then.translation - pose.translation) / h, *turn / h]


class MujocoCells(MujocoFlex):
    """A scene in MuJoCo, with free bodies at the nodes of a grid of cells around the mesh; held are those of the lowest
    layers, up to that which is nearest to the height to which the nodes of the mesh are held."""

    def settle(self, x: Array) -> None:
        for _ in range(_SETTLED):
            self.advance(0.0, 0.0)
            self._data.qvel[:] = 0.0

    def positions(self) -> Array:
        # Of the positions at the end of the step, which it has not computed yet.
        self._mujoco.mj_kinematics(self._model, self._data)
        self._mujoco.mj_flex(self._model, self._data)
        return np.array(self._data.flexvert_xpos)

    def _spec(self) -> Any:
        own, mesh = (
            self._options,
            self._scene.body.mesh,
        )  # the mass given is spread over the nodes that are free
        assert own.cells is not None
        nodes = [own.order * count for count in own.cells]
        height = float(self._rest[self._scene.held, 2].max() - self._rest[:, 2].min())
        layers = round(height / float(np.ptp(self._rest[:, 2])) * nodes[2])
        form = "trilinear" if own.order == 1 else "quadratic"
        text = f"""<mujoco><worldbody><flexcomp name="body" type="direct" dim="3" dof="{form}" radius="0"
            mass="{self._scene.body.node_mass[self._free].sum()}" cellcount="{_words(own.cells)}"
            point="{_words(self._rest.ravel())}" element="{_words(mesh.cells.ravel())}">
            <pin gridrange="0 0 0 {nodes[0]} {nodes[1]} {layers}"/></flexcomp></worldbody></mujoco>"""
        spec = self._mujoco.MjSpec.from_string(text)
        self._set_options(spec)
        self._set_material(spec.flexes[0])
        return spec


def settings() -> Iterator[Setting]:
    """All rows of MuJoCo. Its default step is 2 ms, that of its flex models 1 or 2 ms; their solver is CG or Newton,
    with a tolerance of 1e-6."""
    for parts in (1, 2, 4, 8, 16):
        yield _setting(Options(FRAME / parts))
    for parts in (1, 4, 8):
        yield _setting(Options(FRAME / parts, contact="firm"))
    for parts in (1, 8):
        yield _setting(Options(FRAME / parts, contact="as in its models"))
    yield _setting(Options(FRAME / 4.0, law=0))
    for iterations in (5, 20):
        yield _setting(Options(FRAME / 4.0, iterations=iterations))
    yield _setting(Options(FRAME / 4.0, tolerance=1e-10, iterations=1000))
    yield _setting(Options(FRAME, solver="Newton", tolerance=1e-8))


def cell_settings() -> Iterator[Setting]:
    """All rows of MuJoCo's cells, with Newton's method for few cells and conjugate gradients for many."""
    newton: dict[str, Any] = {"solver": "Newton", "tolerance": 1e-8}
    for count in (3, 6, 9):
        yield _setting(Options(FRAME, contact="firm", cells=(count, count, 2 * count // 3), **newton))
    for count in (12, 15, 18, 24):
        yield _setting(Options(FRAME, contact="firm", cells=(count, count, 2 * count // 3)))
    for parts in (2, 8):
        yield _setting(Options(FRAME / parts, contact="firm", cells=(12, 12, 8)))
    yield _setting(Options(FRAME, contact="firm", cells=(3, 3, 2), order=2, **newton))
    yield _setting(Options(FRAME, contact="firm", cells=(6, 6, 4), order=2))
    for contact in ("firm", "stiff"):
        yield _setting(Options(FRAME / 8.0, contact=contact, cells=(6, 6, 4), **newton))
    yield _setting(Options(FRAME, cells=(6, 6, 4), **newton))


def _setting(options: Options) -> Setting:
    note = f"{options.solver} to {options.tolerance:.0e}, contact {options.contact}"
    if options.cells is None:
        law = LAWS[options.law]
        return Setting(
            NAME, law, note, options.step, options.iterations, lambda scene: MujocoFlex(scene, options)
        )
    note = f"{' x '.join(map(str, options.cells))} cells of order {options.order}, {note}"
    return Setting(
        CELLS, OF_CELLS, note, options.step, options.iterations, lambda scene: MujocoCells(scene, options)
    )


def _words(numbers: Sequence[float] | Array | IntArray) -> str:
    return " ".join(f"{number:.9g}" for number in numbers)
