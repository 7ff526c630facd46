"""Build a reduced body from an experiment's [body] table, or from parts made in Python."""

from __future__ import annotations

import hashlib
import logging
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from softprint.runtime.arrays import Array
from softprint.runtime.body.basis import biharmonic_basis
from softprint.runtime.body.body import HOLDS, SUBSPACES, ReducedBody
from softprint.runtime.body.cubature import build_cubature
from softprint.runtime.body.handles import Handles
from softprint.runtime.body.placement import frames_of, in_box, place_handles
from softprint.runtime.body.skinning import skinning_basis
from softprint.runtime.body.surface_samples import sample_surface
from softprint.runtime.elasticity.materials import Material, make_material
from softprint.runtime.errors import SoftprintError
from softprint.runtime.io.files import content_hash
from softprint.runtime.mesh import Mesh, read_mesh

if TYPE_CHECKING:
    from softprint.runtime.experiment import BodySpec, MaterialSpec

log = logging.getLogger(__name__)

# Of `SUBSPACES`.
_BASES = {"biharmonic_coordinates": biharmonic_basis, "linear_blend_skinning": skinning_basis}


def build_body(spec: BodySpec, base_dir: Path | str, seed: int = 0, dim: int | None = None) -> ReducedBody:
    """The body of an experiment's [body] table; paths in it are relative to base_dir.

    ``seed`` only draws the states at which the cubature error is measured. ``dim`` is the experiment's dimension, which
    the mesh must have. Raises SoftprintError for invalid meshes, handles and materials.
    """
    path = Path(base_dir) / spec.mesh
    mesh = read_mesh(path)
    if dim not in (None, mesh.dim):
        raise SoftprintError(
            f"{path}: this mesh is {mesh.dim}D, but dynamics.gravity has {dim} numbers, as for {dim}D"
        )
    handles = place_handles(mesh, spec.handles.points, frames_of(mesh, spec.handles.frames))
    material, density = material_of_cells(mesh, spec.material)
    return assemble_body(
        mesh,
        handles,
        material,
        density,
        points_per_row=spec.cubature.points_per_row,
        surface_samples=spec.surface.samples,
        rng=np.random.default_rng(seed),
        name=path.stem,
        subspace=spec.handles.subspace,
        hold=spec.handles.hold,
    )


def body_recipe(spec: BodySpec, base_dir: Path | str, seed: int = 0) -> str:
    """A hash of all that :func:`build_body` reads: the table, the mesh file's bytes, the seed."""
    path = Path(base_dir) / spec.mesh
    try:
        mesh = hashlib.sha256(path.read_bytes()).hexdigest()
    except OSError as error:
        raise SoftprintError(f"{path}: the mesh file cannot be read: {error.strerror}") from error
    return content_hash({"table": spec.model_dump_json(exclude={"mesh"}), "mesh": mesh, "seed": seed})


def material_of_cells(mesh: Mesh, spec: MaterialSpec) -> tuple[Material, Array]:
    """Material and density (n_cells,) [kg/m^dim]: a later region overrides an earlier one where it gives a
    value.

    A cell belongs to a region when its centroid lies in the region's box.
    """
    values = {
        key: np.full(mesh.n_cells, float(getattr(spec, key))) for key in ("young", "poisson", "density")
    }
    for number, region in enumerate(spec.regions):
        inside = in_box(mesh.cell_centroids, region.box)
        if not inside.any():
            raise SoftprintError(
                f"body.material.regions[{number}]: no cell has its centroid in the box {region.box}"
            )
        for key, array in values.items():
            if getattr(region, key) is not None:
                array[inside] = getattr(region, key)
    return make_material(spec.model, values["young"], values["poisson"]), values["density"]


def assemble_body(
    mesh: Mesh,
    handles: Handles,
    material: Material,
    density: ArrayLike,
    *,
    points_per_row: int = 10,
    surface_samples: int = 3000,
    rng: np.random.Generator | None = None,
    name: str = "body",
    basis: Array | None = None,
    subspace: str = "biharmonic_coordinates",
    hold: str = "mass",
) -> ReducedBody:
    """A reduced body from its parts: basis, lumped mass, cubature and surface samples are computed here.

    material and density [kg/m^dim] may be scalars: they are spread over all cells. subspace: a key of `SUBSPACES`;
    basis: U (n_nodes, n_rows) of that kind if it was computed elsewhere; hold: see `ReducedBody.constraint_basis`.
    Raises SoftprintError for what is no body.
    """
    for key, value, known in (("subspace", subspace, SUBSPACES), ("hold", hold, HOLDS)):
        if value not in known:
            raise SoftprintError(f"body: {key} must be one of {', '.join(known)}, not {value!r}")
    for key, count in (("points_per_row", points_per_row), ("surface_samples", surface_samples)):
        if count < 1:
            raise SoftprintError(f"body: {key} must be at least 1, not {count}")
    material = make_material(
        material.model, np.full(mesh.n_cells, material.young), np.full(mesh.n_cells, material.poisson)
    )
    cell_density = np.full(mesh.n_cells, np.asarray(density, dtype=np.float64))
    if not (np.isfinite(cell_density).all() and (cell_density > 0).all()):
        raise SoftprintError(f"body: density must be positive, it is {cell_density.min()} kg/m^{mesh.dim}")
    if basis is None:
        basis = _BASES[subspace](mesh, handles)
    node_mass = mesh.lump(mesh.cell_volumes * cell_density)
    cubature = build_cubature(mesh, basis, handles, material, points_per_row, rng or np.random.default_rng(0))
    log.info(
        "%s: %d cubature cells of %d, energy error %.2g %%, force error %.2g %%",
        *(name, len(cubature.cells), mesh.n_cells, 100 * cubature.energy_error, 100 * cubature.force_error),
    )
    return ReducedBody(
        mesh=mesh,
        handles=handles,
        basis=basis,
        material=material,
        density=cell_density,
        node_mass=node_mass,
        reduced_mass=basis.T @ (node_mass[:, None] * basis),
        cubature=cubature,
        surface=sample_surface(mesh, surface_samples),
        name=name,
        subspace=subspace,
        hold=hold,
    )
