"""A truth of internal equilibria for tests: a bar of triangles that is stretched, and turned under gravity."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

from softprint.fem_truth.elasticity.full_space_elasticity import FullSpaceElasticity
from softprint.fem_truth.sampling.recorded_states import disturbed_states
from softprint.fem_truth.statics.constrained import ConstrainedProblem
from softprint.runtime.body import ReducedBody, assemble_body, frame_in_box, place_handles
from softprint.runtime.body.rotations import rotation_exponential
from softprint.runtime.contact import PenaltyContact
from softprint.runtime.elasticity.materials import make_material
from softprint.runtime.mesh import box_mesh
from softprint.runtime.truth.truth_file import TruthHeader, create_truth

FRAMES, DISTURBED = 12, 4


def made_bar() -> ReducedBody:
    """A bar of a few hundred triangles between two frames, with 3 points."""
    mesh = box_mesh([0.0, 0.0], [0.08, 0.02], [24, 6])
    ends = [
        frame_in_box(mesh, "left", [[-1, -1], [0.004, 1]]),
        frame_in_box(mesh, "right", [[0.076, -1], [1, 1]]),
    ]
    return assemble_body(
        mesh, place_handles(mesh, 3, ends), make_material("stable_neo_hookean", 2e4, 0.4), 1e3
    )


def written_truth(
    body: ReducedBody, path: Path, gravity: tuple[float, float], told: tuple[float, float] = (0.0, 0.0)
) -> Path:
    """Of a bar that is stretched; under gravity it is turned, too. told: the gravity that the file names."""
    problem = ConstrainedProblem(FullSpaceElasticity(body), np.array(gravity), PenaltyContact(1e9), body)
    states = []
    for step in range(FRAMES):
        rows = body.rest_rows.copy()
        pull = 0.02 * (step + 1) / FRAMES
        rows[:3, 0] += pull * body.rest_rows[:3, 0] / 0.08
        rows[body.handles.rows_of("right")][-1, 0] += pull
        if any(gravity):
            rows = rows @ rotation_exponential(np.array([0.5 * step])).T
        states.append(rows)
    rows = disturbed_states(body, np.array(states), DISTURBED, 0.004, np.random.default_rng(3))
    columns: dict[str, list[object]] = {}
    for number, own in enumerate(rows):
        solved = problem.internal_equilibrium(own)
        assert solved.converged
        row = {
            "rows": own,
            "internal": solved.x - body.reduced_positions(own),
            "scene": "stretch",
            "frame": number // (1 + DISTURBED),
            "time": 0.0,
        }
        measures = "residual decrement min_det_F min_eigenvalue energy handle_force stable seconds"
        row |= {name: getattr(solved, name) for name in measures.split()}
        for name, value in row.items():
            columns.setdefault(name, []).append(value)
    header = TruthHeader(body.content_hash, "", 0, (), 0, {"dynamics.gravity": json.dumps(told)})
    with create_truth(path, header, body) as truth:
        truth.append("states", columns)
    return path
