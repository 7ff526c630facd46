"""The gizmo that leads a handle of the body: a point, or a frame such as a base or a bone."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np

from softprint.runtime.arrays import Array
from softprint.runtime.body.body import ReducedBody
from softprint.runtime.colliders import RigidPose
from softprint.runtime.viewer.page.collider_views import rotation_of
from softprint.runtime.viewer.page.solids import in_space
from softprint.runtime.viewer.session.commands import LeadHandle

if TYPE_CHECKING:
    import viser


class HandleGizmo:
    """Leads one handle at a time, from where it is."""

    def __init__(
        self, server: viser.ViserServer, body: ReducedBody, send: Callable[[LeadHandle], None]
    ) -> None:
        self._server, self._body, self._send = server, body, send
        self._node: Any = None

    def lead(self, handle: int | str | None, rows: Array) -> None:
        """Put the gizmo on a handle of a body with these rows, or away."""
        if self._node is not None:
            self._node.remove()
            self._node = None
        if handle is None:
            return
        body, dim = self._body, self._body.dim
        rest = body.handles.position(body.rest_rows, handle)
        turned = rows[body.handles.rows_of(handle)][:-1].T if isinstance(handle, str) else np.eye(dim)
        position, wxyz = in_space(RigidPose(turned, body.handles.position(rows, handle)))
        self._node = node = self._server.scene.add_transform_controls(
            "/handle",
            scale=0.35 * body.mesh.size,
            active_axes=(True, True, dim == 3),
            disable_rotations=not isinstance(handle, str),
            depth_test=False,
            opacity=0.9,
            position=position,
            wxyz=wxyz,
        )

        @node.on_update
        async def _(event: Any) -> None:
            if event.phase == "start":
                return
            at: Array = np.asarray(event.target.position, dtype=float)[:dim]
            turn = rotation_of(event.target.wxyz)[:dim, :dim] if isinstance(handle, str) else None
            self._send(LeadHandle(handle, at - rest, turn))
