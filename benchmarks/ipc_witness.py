"""Contact of full space against a witness of another kind: incremental potential contact (Li et al. 2020), mesh against
mesh, free of intersections by construction.

    pip install ipctk==1.6.1
    python -m benchmarks.ipc_witness [--shapes needle ...] [--cells 12] [--depths 0.002 0.004]

A block of 60 x 60 x 40 mm stands on a rigid floor. Six solids with thin limbs and sharp edges are pressed into its
top: by the IPC Toolkit, with the triangles of the solid and of the block and with barriers that act within 0.2 and 0.1
mm; and by Softprint, with a signed distance sampled from the same triangles and a penalty, at nodes and at points of
facets. Both have the same cells and the same elasticity, so that only contact differs. A barrier keeps surfaces apart
and a penalty lets them overlap; both effects vanish with the distance of the barrier and with the stiffness, and the
forces are also extrapolated to these limits, linearly in the distance and in the square root of 1 / stiffness.

Intrusion is the depth of the solid's surface inside the deformed block, found without either law.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass

import igl
import numpy as np
import trimesh
from scipy.sparse.linalg import splu

from softprint.fem_truth.elasticity.full_space_elasticity import FullSpaceElasticity
from softprint.fem_truth.energy.surface_contact import SurfaceContact
from softprint.fem_truth.verify.problems.equilibrium import Solid, equilibrium
from softprint.runtime.arrays import Array, IntArray
from softprint.runtime.cli.script import run_script
from softprint.runtime.colliders import Collider, RigidPose
from softprint.runtime.colliders.library import library_surface
from softprint.runtime.colliders.surface_mesh.mesh_collider import mesh_collider
from softprint.runtime.contact import PenaltyContact
from softprint.runtime.contact.intrusion import intrusion
from softprint.runtime.contact.sharp_planes import SharpPlanes, SharpSurface
from softprint.runtime.contact.surface_quadrature import SurfaceQuadrature
from softprint.runtime.elasticity.materials import make_material
from softprint.runtime.errors import SoftprintError
from softprint.runtime.mesh import Mesh, box_mesh

SIZE = np.array([0.06, 0.06, 0.04])  # m, of the block
YOUNG, POISSON = 2e4, 0.4
BARRIERS = (2e-4, 1e-4)  # m
# Of the barrier [Pa]: it changes how wide a gap a pressure leaves and not the limit.
BARRIER_STIFFNESS = 1e5
STIFFNESSES = (3e10, 3e11, 3e12)  # N/m^4
POINTS_ALONG = 4
RESOLUTION = 96
# Of a library shape, after decimation.
_TRIANGLES = 2000
# m, of the collider between two equilibria of the penalty.
STEP = 5e-4
# Converged where the residual is that fraction of the elastic forces, or a step could gain so little of the energy.
_ITERATIONS, _TOLERANCE, _DECREMENT = 100, 1e-6, 1e-11
_FLOOR = 1e-15  # of the energy at a strain of one: round-off
_CLOSEST = 0.8  # fraction of the way to the first contact that the collider is moved at once


@dataclass(frozen=True, eq=False)
class Triangles:
    """A closed surface in metres whose lowest point is at height zero."""

    vertices: Array
    faces: IntArray

    @classmethod
    def of(cls, solid: trimesh.Trimesh) -> Triangles:
        """A solid in millimetres, with edges of at most 4 mm."""
        fine = _subdivided(solid, 4.0)
        return cls._lowered(1e-3 * np.asarray(fine.vertices), np.asarray(fine.faces, dtype=np.int64))

    @classmethod
    def of_library(cls, name: str, size: float) -> Triangles:
        """A shape of the library, with fewer triangles; size: half of its longest side [m]."""
        vertices, faces = library_surface(name, size)
        coarse, triangles, _, _ = igl.decimate(vertices, faces, _TRIANGLES)
        return cls._lowered(coarse, triangles.astype(np.int64))

    def collider(self) -> Collider:
        """With a signed distance sampled from the triangles."""
        return mesh_collider(self.vertices, self.faces, RESOLUTION, "solid")

    @classmethod
    def _lowered(cls, vertices: Array, faces: IntArray) -> Triangles:
        vertices = vertices - vertices[:, 2].min() * np.eye(3)[2]
        return cls(vertices, faces)


def _needle() -> trimesh.Trimesh:
    cone = trimesh.creation.cone(radius=3.0, height=18.0, sections=16)
    cone.apply_transform(trimesh.transformations.rotation_matrix(np.pi, [1, 0, 0]))
    return cone


def _tetrahedron() -> trimesh.Trimesh:
    corners = 14.0 * np.array([[0, 0, -1], [0.94, 0, 0.33], [-0.47, 0.82, 0.33], [-0.47, -0.82, 0.33]])
    return trimesh.Trimesh(corners, [[0, 2, 1], [0, 3, 2], [0, 1, 3], [1, 2, 3]])


def _ring() -> trimesh.Trimesh:
    ring = trimesh.creation.torus(major_radius=10.0, minor_radius=1.5, major_sections=32, minor_sections=12)
    ring.apply_transform(trimesh.transformations.rotation_matrix(np.pi / 2, [1, 0, 0]))
    return ring


SHAPES: Mapping[str, Callable[[], Triangles]] = {
    "plate, edge-on": lambda: Triangles.of(trimesh.creation.box([24.0, 2.0, 16.0])),
    "needle": lambda: Triangles.of(_needle()),
    "tetrahedron": lambda: Triangles.of(_tetrahedron()),
    "ring, upright": lambda: Triangles.of(_ring()),
    "starfish": lambda: Triangles.of_library("starfish", 0.014),
    "coral": lambda: Triangles.of_library("coral", 0.014),
}


@dataclass(frozen=True, eq=False)
class Pressed:
    """A block in equilibrium. x (n, 3) [m]; force: on the collider, upward [N]; gap: between the surfaces, negative
    where they overlap [m]."""

    x: Array
    force: float
    gap: float


class Block:
    """The block, and its equilibria with a solid above the middle of its top."""

    def __init__(self, cells: int) -> None:
        divisions = [cells, cells, max(2, round(cells * SIZE[2] / SIZE[0]))]
        lower = np.array([-0.5 * SIZE[0], -0.5 * SIZE[1], 0.0])
        self.mesh: Mesh = box_mesh(lower.tolist(), (lower + SIZE).tolist(), divisions)
        self.elasticity = FullSpaceElasticity(
            Solid(self.mesh, make_material("stable_neo_hookean", YOUNG, POISSON))
        )
        self.held = self.mesh.points[:, 2] == 0.0

    def by_penalty(
        self, solid: Triangles, stiffness: float, refinement: int, depths: Sequence[float]
    ) -> Iterator[Pressed]:
        """Pressed by Softprint: refinement 0 is contact at nodes."""
        mesh = self.mesh
        collider, points = solid.collider(), SurfaceQuadrature.of(mesh, refinement)
        law = PenaltyContact(stiffness, refinement)
        sharp, normals = SharpSurface.of(collider, law, mesh), np.zeros_like(mesh.points)
        normals[mesh.surface_nodes] = mesh.surface_normals  # of a block that is held, and whose top is flat
        x, held, before = mesh.points.copy(), np.repeat(self.held[:, None], 3, axis=1), 0.0
        for depth in depths:
            for part in np.linspace(before, depth, 1 + max(1, round((depth - before) / STEP)))[1:]:
                planes = None if sharp is None else SharpPlanes(sharp, normals)
                contact = SurfaceContact(law, points, collider, _at(SIZE[2] - part), planes)
                x = equilibrium(self.elasticity, held, x, (contact,), tolerance=1e-6)
            before = depth
            yield Pressed(x, float(contact.gradient(x)[:, 2].sum()), -contact.max_depth(x))

    def by_barrier(self, solid: Triangles, distance: float, depths: Sequence[float]) -> Iterator[Pressed]:
        """Pressed by the IPC Toolkit."""
        pressed = _Barrier(self, solid, distance)
        x, height = self.mesh.points.copy(), SIZE[2] + 2.0 * distance
        ahead, moved = np.zeros_like(x), 1.0
        for depth in depths:
            target = SIZE[2] - depth
            while height > target + 1e-12:
                # The block is carried on as in the last step, so that the solid may move farther than the gap.
                way = min(height - target, STEP)
                step = (way / moved) * ahead
                share = pressed.free_share(x, height, x + step, height - way)
                share = 1.0 if share >= 1.0 else _CLOSEST * share
                if share < 0.02:
                    step, share = np.zeros_like(x), _CLOSEST * pressed.free_share(x, height, x, height - way)
                start, height, moved = x, height - share * way, max(share * way, 1e-9)
                x = pressed.equilibrium(x + share * step, height)
                ahead = x - start
            yield Pressed(x, *pressed.force_and_gap(x, height))

    def intrusion(self, solid: Triangles, x: Array, depth: float) -> float:
        """How deep the solid is inside the block [m]."""
        dense = _subdivided(trimesh.Trimesh(solid.vertices, solid.faces), 5e-4)
        return intrusion(_at(SIZE[2] - depth).apply(np.asarray(dense.vertices)), self.mesh, x).depth


class _Barrier:
    """The energy of the block and of the barrier between it and a solid that is held at a height."""

    def __init__(self, block: Block, solid: Triangles, distance: float) -> None:
        from softprint.fem_truth.energy import barrier_contact  # needs the IPC Toolkit

        self._barrier, self._block = barrier_contact, block
        self._free = np.flatnonzero(np.repeat(~block.held, 3))
        law = barrier_contact.BarrierLaw(distance, BARRIER_STIFFNESS)
        self._surfaces = barrier_contact.CollisionSurfaces(block.mesh, solid.collider(), law)

    def free_share(self, x: Array, height: float, x_end: Array, height_end: float) -> float:
        """The share of a motion that is free of collisions."""
        start, end = self._surfaces.vertices(x, _at(height)), self._surfaces.vertices(x_end, _at(height_end))
        return self._surfaces.free_share(start, end)

    def equilibrium(self, x: Array, height: float) -> Array:
        """Newton's method, each step as long as nothing collides. Raises SoftprintError where it does not converge."""
        elasticity, free = self._block.elasticity, self._free
        contact = self._barrier.BarrierContact(self._surfaces, _at(height), x)
        for _ in range(_ITERATIONS):
            elastic = elasticity.gradient(x)
            gradient = (elastic + contact.gradient(x)).ravel()[free]
            scale = max(float(np.linalg.norm(elastic)), 1e-4 * elasticity.unit_force)
            if np.linalg.norm(gradient) <= _TOLERANCE * scale:
                return x
            matrix = elasticity.hessian(x)
            contact.add_hessian(x, matrix, convex=True)
            hessian = matrix.sparse()
            direction = np.zeros(x.size)
            direction[free] = -splu(hessian[free][:, free].tocsc()).solve(gradient)
            step = direction.reshape(x.shape)
            before = elasticity.energy(x) + contact.energy(x)
            slope = float(gradient @ direction[free])
            if -slope <= max(_DECREMENT * before, _FLOOR * elasticity.unit_energy):
                return x
            share = min(1.0, 0.9 * self.free_share(x, height, x + step, height))
            y = x + share * step
            while elasticity.energy(y) + contact.energy(y) > before + 1e-4 * share * slope:
                share *= 0.5
                if share < 1e-8:
                    raise SoftprintError(f"the barrier's line search failed at height {height}")
                y = x + share * step
            x = y
            contact.accepted(x)
        raise SoftprintError(f"the barrier did not converge at height {height}")

    def force_and_gap(self, x: Array, height: float) -> tuple[float, float]:
        """The force on the solid, upward [N], and the least distance between the surfaces [m]."""
        contact = self._barrier.BarrierContact(self._surfaces, _at(height), x)
        return float(contact.gradient(x)[:, 2].sum()), contact.gap(x)


def _subdivided(surface: trimesh.Trimesh, longest: float) -> trimesh.Trimesh:
    """With edges of at most this length."""
    fine = surface.subdivide_to_size(longest)
    assert isinstance(fine, trimesh.Trimesh)  # it is a tuple only where the numbers of the faces are asked for
    return fine


def _at(height: float) -> RigidPose:
    return RigidPose(np.eye(3), np.array([0.0, 0.0, height]))


def _until_failure(pressed: Iterator[Pressed], count: int) -> list[Pressed | None]:
    """The equilibria at all depths (count,); None from the first on that is not found."""
    found: list[Pressed | None] = []
    with suppress(SoftprintError):
        found.extend(pressed)
    return found + [None] * (count - len(found))


def rows(block: Block, name: str, depths: Sequence[float]) -> Iterator[str]:
    """Lines of the table for one shape."""
    solid = SHAPES[name]()
    barrier = [list(block.by_barrier(solid, distance, depths)) for distance in BARRIERS]
    laws: dict[str, list[Pressed | None]] = {
        f"barrier, {1e3 * distance:g} mm": [*found] for distance, found in zip(BARRIERS, barrier, strict=True)
    }
    for stiffness in STIFFNESSES:
        pressed = block.by_penalty(solid, stiffness, POINTS_ALONG, depths)
        laws[f"facets, {stiffness:.0e}"] = _until_failure(pressed, len(depths))
    for stiffness in (STIFFNESSES[0], STIFFNESSES[-1]):
        laws[f"nodes, {stiffness:.0e}"] = _until_failure(
            block.by_penalty(solid, stiffness, 0, depths), len(depths)
        )
    for at, depth in enumerate(depths):
        witness = barrier[-1][at]
        # Linear in the distance: the last two, one twice the other.
        limit = 2.0 * witness.force - barrier[-2][at].force
        for law, found in laws.items():
            yield f"| {name} | {1e3 * depth:g} | {law} | {_cells(block, solid, depth, found[at], witness, limit)} |"
        soft, hard = (laws[f"facets, {k:.0e}"][at] for k in STIFFNESSES[-2:])
        # Linear in k^(-1/2): the last two, a factor of 10.
        share = 1.0 / (np.sqrt(STIFFNESSES[-1] / STIFFNESSES[-2]) - 1.0)
        if soft is not None and hard is not None:
            force = hard.force + share * (hard.force - soft.force)
            yield f"| {name} | {1e3 * depth:g} | facets, limit | {force:.3f} | {force / limit - 1.0:+.1%} | | | |"


def _cells(
    block: Block, solid: Triangles, depth: float, found: Pressed | None, witness: Pressed, limit: float
) -> str:
    """Force, how far it is from the limit of the barrier, displacement off, gap and intrusion."""
    if found is None:
        return "no equilibrium | | | |"
    off = np.linalg.norm(found.x - witness.x) / np.linalg.norm(witness.x - block.mesh.points)
    inside = block.intrusion(solid, found.x, depth)
    return (
        f"{found.force:.3f} | {found.force / limit - 1.0:+.1%} | {off:.1%} | {1e3 * found.gap:+.2f} | "
        f"{1e3 * inside:.2f}"
    )


def main(arguments: Sequence[str] | None = None) -> None:
    """Prints a table in Markdown."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--shapes", nargs="+", choices=list(SHAPES), default=list(SHAPES))
    parser.add_argument("--cells", type=int, default=12, help="along the longer edges of the block")
    parser.add_argument("--depths", type=float, nargs="+", default=[0.002, 0.004], help="[m], ascending")
    options = parser.parse_args(arguments)
    block = Block(options.cells)
    spacing = block.mesh.surface_spacing
    print(
        f"{block.mesh.n_nodes} nodes, {block.mesh.n_cells} tetrahedra, surface nodes {1e3 * spacing:.2f} mm apart"
    )
    heads = ["solid", "depth, mm", "contact", "force, N", "from the limit of the barrier", "displacement off"]
    heads += ["gap, mm", "intrusion, mm"]
    print("| " + " | ".join(heads) + " |\n" + "| --- " * len(heads) + "|")
    for name in options.shapes:
        for row in rows(block, name, options.depths):
            print(row, flush=True)


if __name__ == "__main__":
    run_script(main)
