"""A truth file of six made-up samples, and an experiment with one short scene."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from softprint.runtime.colliders.pose import rotation_matrix
from softprint.runtime.truth.truth_file import TruthHeader, create_truth
from softprint.runtime.truth.truth_schema import TABLES, UNREACHED


def turned(dim: int, angle: float) -> np.ndarray:
    return rotation_matrix([angle] if dim == 2 else [0.3 * angle, angle, -0.5 * angle], dim)


def write_truth(path: Path, body) -> None:
    """Two states, three contacts of two depths; the fourth sample has failed. The ball comes from above."""
    rng, dim = np.random.default_rng(0), body.dim
    sizes = {"nodes": body.n_nodes, "rows": body.n_rows, "dim": dim}

    def table(name, n, **given):
        columns = {}
        for key, column in TABLES[name].items():
            zeros = np.zeros(
                (n, *column.row_shape(sizes)), dtype=object if column.dtype == "str" else column.dtype
            )
            columns[key] = [""] * n if column.dtype == "str" else zeros
        return columns | given

    rows = np.stack([body.rest_rows, body.rest_rows])
    rows[1, : body.handles.n_points] += 2e-3 * rng.standard_normal((body.handles.n_points, dim))
    rows[1] = body.handles.with_frame(rows[1], "base", turned(dim, 0.2), np.full(dim, 3e-3))
    internal = 1e-4 * rng.standard_normal((2, body.n_nodes, dim))
    top = body.mesh.points[body.mesh.points[:, -1] > 0.0599]
    above = top[np.argmin(np.abs(top[:, :-1]).max(axis=1))]
    header = TruthHeader(body.content_hash, "[experiment]", 7, ("ball",), 3)
    with create_truth(path, header, body) as truth:
        truth.append("states", table("states", 2, rows=rows, internal=internal))
        truth.append("refused", table("refused", 0))
        truth.append("contacts", table("contacts", 3, state=[0, 0, 1]))
        truth.append(
            "samples",
            table(
                *("samples", 6),
                contact=[0, 0, 1, 1, 2, 2],
                depth_index=[0, 1, 0, 1, 0, 1],
                status=[0, 0, 0, UNREACHED, 0, 0],
                min_det_F=np.full(6, 0.5),
                pose_rotation=np.stack([turned(dim, angle) for angle in (0.1, 0.1, 0.9, 0.9, 0.9, 0.9)]),
                pose_translation=above
                + np.array([19e-3 - 1e-3 * k for k in range(6)])[:, None] * np.eye(dim)[-1],
                displacement=1e-3 * rng.standard_normal((6, body.n_nodes, dim)),
            ),
        )
        truth.append("repeat", table("repeat", 0))


# A ball and a block of 0.1 x 0.05 m (`box.vtu`), without friction; scenes are to follow.
BLOCK = """
[experiment]
name = "toy"
[body]
mesh = "box.vtu"
[body.handles]
points = 5
frames = [{ name = "base", box = [[-1, -1], [0.015, 1]] }]
[body.material]
model = "stable_neo_hookean"
young = 1e5
poisson = 0.4
density = 1000.0
[[colliders]]
name = "ball"
shape = "circle"
radius = 0.02
[contact]
stiffness = 1e9
friction = 0.0
[dynamics]
gravity = [0, -9.81]
"""

# In contact.
PRESS = f"""{BLOCK}
[[scenes]]
name = "press"
role = "test"
duration = 0.06
kinematic = ["base"]
[[scenes.colliders]]
name = "ball"
keyframes = [{{ time = 0.0, position = [0.08, 0.066] }}]
"""
