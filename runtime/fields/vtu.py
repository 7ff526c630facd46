"""VTK files of fields, and the collection (.pvd) that lets ParaView play them as one series.

Points are at the *deformed* positions; "Warp By Vector" with ``displacement`` and scale -1 shows the body at rest.
Vectors have three components and tensors nine (row by row) in 2D too, as VTK requires.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

from softprint.runtime.arrays import Array, IntArray
from softprint.runtime.fields.deformed import FieldSet
from softprint.runtime.io.files import atomic_path

_CELLS = {2: "triangle", 3: "tetra"}
_FACETS = {2: "line", 3: "triangle"}


def write_fields(path: Path, fields: FieldSet) -> None:
    """Write one .vtu, atomically: float64 points, fields and cells, compressed."""
    import meshio

    mesh = meshio.Mesh(
        _padded(fields.positions),
        [(_CELLS[fields.mesh.dim], fields.mesh.cells)],
        point_data={name: _padded(values) for name, values in fields.nodes.items()},
        cell_data={
            name: [values.reshape(len(values), -1).squeeze()] for name, values in fields.cells.items()
        },
    )
    with atomic_path(path) as temporary:
        meshio.write(temporary, mesh)


def write_surface(path: Path, vertices: Array, facets: IntArray) -> None:
    """Write segments (f, 2) or triangles (f, 3) as one .vtu: a collider for ParaView."""
    import meshio

    with atomic_path(path) as temporary:
        meshio.write(temporary, meshio.Mesh(_padded(vertices), [(_FACETS[vertices.shape[1]], facets)]))


def write_collection(path: Path, parts: Sequence[tuple[float, str, Path]]) -> None:
    """Write the .pvd of (time, name of the part, file); files are named relative to the folder of ``path``."""
    root = ElementTree.Element("VTKFile", type="Collection", version="1.0", byte_order="LittleEndian")
    collection = ElementTree.SubElement(root, "Collection")
    names = list(dict.fromkeys(name for _, name, _ in parts))
    for time, name, file in parts:
        ElementTree.SubElement(
            collection,
            "DataSet",
            timestep=repr(float(time)),
            part=str(names.index(name)),
            name=name,
            file=file.relative_to(path.parent).as_posix(),
        )
    ElementTree.indent(root)
    with atomic_path(path) as temporary:
        ElementTree.ElementTree(root).write(temporary, encoding="utf-8", xml_declaration=True)


def _padded(values: Array) -> NDArray[np.float64]:
    """2D vectors get a third component, 0; scalars are unchanged."""
    if values.ndim == 1:
        return values
    padded = np.zeros((len(values), 3))
    padded[:, : values.shape[1]] = values
    return padded
