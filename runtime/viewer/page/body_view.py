"""One body in the scene of the page, coloured by vertex, with its contact points and the spring that pulls it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from softprint.runtime.arrays import Array, IntArray
from softprint.runtime.drawing.colours import BODY
from softprint.runtime.viewer.page.palette import colours, levels, rgb

if TYPE_CHECKING:
    import viser

Reals = NDArray[np.floating[Any]]

# The end of the name of the point cloud that brings the colours of a mesh, see `colours.js`.
COLOURS = "_colours"
# Contact points that are drawn; the cloud always has so many, so that the browser keeps its buffers.
_POINTS = 300
_FAR_AWAY = 1e4  # m, where those are that are none


class BodyView:
    """name: of its nodes in the scene; rest (n, 3) [m], faces (f, 3); offset (3,) [m]: where it stands beside others;
    size [m] of the body."""

    def __init__(
        self,
        server: viser.ViserServer,
        name: str,
        rest: Reals,
        faces: IntArray,
        offset: Array,
        size: float,
        flat: bool,
    ) -> None:
        self.offset = offset
        scene, blank = server.scene, np.full((len(rest), 3), 255, dtype=np.uint8)
        self.mesh = scene.add_mesh_simple(
            f"/{name}",
            np.asarray(rest, dtype=np.float32),
            np.asarray(faces, dtype=np.uint32),
            color=rgb(BODY),
            side="double",
            flat_shading=flat,
            position=tuple(offset),
        )
        self._cloud = scene.add_point_cloud(
            f"/{name}{COLOURS}", np.zeros((len(rest), 3), dtype=np.float32), blank, visible=False
        )
        far = np.full((_POINTS, 3), _FAR_AWAY, dtype=np.float32)
        self._contact = scene.add_point_cloud(
            f"/{name}_contact",
            far,
            np.zeros((_POINTS, 3), dtype=np.uint8),
            point_size=0.012 * size,
            point_shape="circle",
            precision="float32",
            position=tuple(offset),
        )
        self._pull = scene.add_line_segments(
            f"/{name}_pull",
            np.full((1, 2, 3), _FAR_AWAY, dtype=np.float32),
            (30, 30, 40),
            thickness=0.01 * size,
            position=tuple(offset),
        )
        self._pulled = False

    def show(self, vertices: Reals, values: Reals, top: float) -> None:
        """Positions (n, 3) and values (n,) on a scale from 0 to `top`."""
        self.mesh.vertices = vertices
        self._cloud.colors = colours(values, top, linear=True)

    def show_contact(self, points: Reals, sizes: Array, visible: bool) -> None:
        """Contact points (m, 3) [m] and the forces (m,) [N] there."""
        placed = np.full((_POINTS, 3), _FAR_AWAY, dtype=np.float32)
        shades = np.zeros((_POINTS, 3), dtype=np.uint8)
        if visible and len(points):
            largest = np.argsort(sizes)[::-1][:_POINTS]
            placed[: len(largest)] = points[largest]
            share = sizes[largest] / max(float(sizes.max()), 1e-30)
            # From the dark end, so that points stand out from a body in the light colours.
            shades[: len(largest)] = levels()[(255 - 155 * share).astype(np.int64)]
        self._contact.points = placed
        self._contact.colors = shades

    def show_pull(self, pull: tuple[Reals, Reals] | None) -> None:
        """The spring between two points (3,), or none."""
        if pull is None and not self._pulled:
            return
        self._pulled = pull is not None
        far: Reals = np.full(3, _FAR_AWAY)
        self._pull.points = np.array([pull or (far, far)], dtype=np.float32)

    def remove(self) -> None:
        """Take it out of the scene."""
        for node in self.nodes:
            node.remove()

    @property
    def nodes(self) -> list[Any]:
        """All nodes of it in the scene."""
        return [self.mesh, self._cloud, self._contact, self._pull]
