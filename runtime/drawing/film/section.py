"""A body that is cut open by a plane: what is before it is not drawn, and the section is filled."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from softprint.runtime.arrays import Array
from softprint.runtime.drawing.colours import SECTION
from softprint.runtime.drawing.film.subject import Cut
from softprint.runtime.errors import SoftprintError
from softprint.runtime.mesh import Mesh

if TYPE_CHECKING:
    import pyvista as pv


class Section:
    """The cut of a body at one plane. direction: (3,) towards the camera."""

    def __init__(self, plotter: pv.Plotter, mesh: Mesh, cut: Cut, direction: Array) -> None:
        import pyvista as pv

        towards = np.eye(3)[cut.axis] * np.copysign(1.0, direction[cut.axis])
        self._plane = {"normal": tuple(towards), "origin": tuple(np.eye(3)[cut.axis] * cut.value)}
        self._volume = pv.UnstructuredGrid({pv.CellType.TETRA: mesh.cells}, mesh.points.copy())
        self._cap = self._volume.slice(**self._plane)
        if not self._cap.n_points:
            least, most = (end[cut.axis] for end in (mesh.points.min(axis=0), mesh.points.max(axis=0)))
            raise SoftprintError(
                f"--cut {'xyz'[cut.axis]}={cut.value:g}: the plane misses the body, which reaches from {least:.4g} to "
                f"{most:.4g} m"
            )
        plotter.add_mesh(self._cap, color=SECTION, lighting=False)

    def clip(self, actor: Any) -> None:
        """Do not draw what of the actor is on the camera's side."""
        from vtkmodules.vtkCommonDataModel import vtkPlane

        plane = vtkPlane()
        plane.SetOrigin(*self._plane["origin"])
        plane.SetNormal(*(-x for x in self._plane["normal"]))
        actor.mapper.AddClippingPlane(plane)

    def move(self, positions: Array) -> None:
        """To the body at positions (n_nodes, 3)."""
        self._volume.points = positions
        self._cap.copy_from(self._volume.slice(**self._plane))
