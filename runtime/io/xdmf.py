"""XDMF side files: small XML files by which ParaView reads meshes and nodal fields from our HDF5 files.

The data stay in the HDF5 file; the side file only refers to them. This is XDMF 3 as read by both ParaView and VTK:

* ``Values`` names a dataset, or one slice ``dataset[index]`` of its leading axis (a HyperSlab in XDMF);
* ``Step`` is one picture: points, cells, and fields at nodes and cells;
* ``write_xdmf`` writes a temporal collection of steps.

Points should be a whole dataset, not a slice: VTK reads slices of points correctly but prints a warning for each. A
moving body is therefore stored as rest points plus a node field for "Warp By Vector", or one dataset of points per
step. 2D points and vectors are padded with zeros by the reader.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path, PurePosixPath
from typing import Any
from xml.etree import ElementTree

import h5py
import numpy as np

from softprint.runtime.io.files import atomic_path

_GEOMETRY = {2: "XY", 3: "XYZ"}
_TOPOLOGY = {3: "Triangle", 4: "Tetrahedron"}  # by nodes a cell
_ATTRIBUTE = {1: "Scalar", 2: "Vector", 3: "Vector", 4: "Matrix", 9: "Tensor"}  # by numbers a node or cell


@dataclass(frozen=True)
class Values:
    """A reference to an array: a dataset of an HDF5 file, or one slice of its leading axis.

    ``file`` is written to the side file unchanged, so it is relative to the side file (normally the bare name of the
    HDF5 file in the same folder).
    """

    file: str
    dataset: str
    shape: tuple[int, ...]
    dtype: np.dtype[Any]
    index: int | None = None

    @classmethod
    def of(cls, dataset: h5py.Dataset, index: int | None = None) -> Values:
        """Describe an open dataset, or its slice ``dataset[index]``."""
        name = Path(dataset.file.filename).name
        return cls(name, dataset.name, tuple(dataset.shape), dataset.dtype, index)

    @property
    def slice_shape(self) -> tuple[int, ...]:
        """Shape of the array that the reader returns."""
        return self.shape if self.index is None else self.shape[1:]


@dataclass(frozen=True)
class Step:
    """One picture of the collection: a mesh with fields at a time (or any other number that increases with the
    steps)."""

    time: float
    points: Values
    cells: Values
    node_fields: Mapping[str, Values] = field(default_factory=dict)
    cell_fields: Mapping[str, Values] = field(default_factory=dict)
    name: str = "step"


def write_xdmf(path: Path, steps: Sequence[Step]) -> None:
    """Write the side file ``path`` for ``steps`` (in order of time), atomically."""
    root = ElementTree.Element("Xdmf", Version="3.0")
    domain = ElementTree.SubElement(root, "Domain")
    collection = ElementTree.SubElement(
        domain, "Grid", Name="steps", GridType="Collection", CollectionType="Temporal"
    )
    for step in steps:
        _add_step(collection, step)
    ElementTree.indent(root)
    with atomic_path(Path(path)) as temporary:
        ElementTree.ElementTree(root).write(temporary, encoding="utf-8", xml_declaration=True)


def _add_step(parent: ElementTree.Element, step: Step) -> None:
    grid = ElementTree.SubElement(parent, "Grid", Name=step.name, GridType="Uniform")
    ElementTree.SubElement(grid, "Time", Value=repr(float(step.time)))

    n_cells, nodes_a_cell = step.cells.slice_shape
    topology = ElementTree.SubElement(
        grid, "Topology", TopologyType=_TOPOLOGY[nodes_a_cell], NumberOfElements=str(n_cells)
    )
    _add_values(topology, step.cells)

    geometry = ElementTree.SubElement(grid, "Geometry", GeometryType=_GEOMETRY[step.points.slice_shape[1]])
    _add_values(geometry, step.points)

    for center, fields in (("Node", step.node_fields), ("Cell", step.cell_fields)):
        for name, values in fields.items():
            width = int(np.prod(values.slice_shape[1:], dtype=int))
            attribute = ElementTree.SubElement(
                grid, "Attribute", Name=name, AttributeType=_ATTRIBUTE[width], Center=center
            )
            _add_values(attribute, values)


def _add_values(parent: ElementTree.Element, values: Values) -> None:
    number: dict[str, Any] = {
        "NumberType": "Float" if values.dtype.kind == "f" else "Int",
        "Precision": str(values.dtype.itemsize),
    }
    if values.index is not None:
        parent = ElementTree.SubElement(
            parent, "DataItem", ItemType="HyperSlab", Dimensions=_spaced(values.slice_shape), **number
        )
        rank = len(values.shape)
        start = (values.index, *(0 for _ in values.slice_shape))
        selection = ElementTree.SubElement(
            parent, "DataItem", Dimensions=f"3 {rank}", Format="XML", NumberType="Int"
        )
        selection.text = " ".join((_spaced(start), _spaced((1,) * rank), _spaced((1, *values.slice_shape))))
    item = ElementTree.SubElement(
        parent, "DataItem", Dimensions=_spaced(values.shape), Format="HDF", **number
    )
    item.text = f"{values.file}:{PurePosixPath(values.dataset)}"


def _spaced(numbers: Sequence[int]) -> str:
    return " ".join(str(number) for number in numbers)
