"""A block rests on a floor: the floor carries its weight, and its penetration into the floor is known."""

from __future__ import annotations

from typing import Any

import numpy as np

from softprint.fem_truth.verify.case import Case, CaseResult, Curve, Line, Row
from softprint.fem_truth.verify.problems.motion import (
    BOTH,
    FULL,
    REDUCED,
    AnySimulator,
    exact_steps,
    moving,
    nodal,
    play,
    simulator,
)
from softprint.fem_truth.verify.problems.small_bodies import (
    DENSITY,
    Stuff,
    affine_body,
    node_body,
    point_body,
)
from softprint.runtime.body import ReducedBody
from softprint.runtime.colliders import KeyframedPath, Plane, RigidPose
from softprint.runtime.contact import PenaltyContact
from softprint.runtime.dynamics import PlacedCollider, StepResult
from softprint.runtime.mesh import Mesh, box_mesh

_GRAVITY, _HEIGHT, _YOUNG = 9.81, 0.05, 1e5
_STEP = 0.005  # s
_PRESSURE = DENSITY * _GRAVITY * _HEIGHT  # Pa under the block
_STIFFNESS = 1e10


def _mesh(dim: int) -> Mesh:
    width = [0.04] * (dim - 1)
    return box_mesh([0.0] * dim, [*width, _HEIGHT], [4, 8] if dim == 2 else [3, 3, 6])


def _standing(name: str, body: ReducedBody, stiffness: float) -> AnySimulator:
    floor = Plane([0.0] * (body.dim - 1) + [1.0], "floor")
    return simulator(
        name,
        body,
        exact_steps(_STEP, 1e-8),
        [PlacedCollider("floor", floor, KeyframedPath.constant(RigidPose.identity(body.dim)))],
        contact=PenaltyContact(stiffness, refinement=0),
        gravity=[0.0] * (body.dim - 1) + [-_GRAVITY],
    )


def _settled(model: AnySimulator) -> StepResult[Any]:
    """Starts slightly inside the floor: without contact there is no equilibrium."""
    rows = model.body.rest_rows.copy()
    rows[:, -1] -= 1e-4
    return model.settle(moving(model, rows, np.zeros_like(rows)), exact_steps(_STEP, 1e-8).newton)


def _weight_rows(name: str, dim: int, steps: int) -> list[Row]:
    """In equilibrium, and some time after a fall of a millimetre."""
    body = point_body(_mesh(dim), Stuff("stable_neo_hookean", 2e4, 0.4), 8)
    model = _standing(name, body, _STIFFNESS)
    weight = float(body.node_mass.sum()) * _GRAVITY
    rows = body.rest_rows.copy()
    rows[:, -1] += 1e-3
    for result in play(model, moving(model, rows, np.zeros_like(rows)), steps):
        fallen = result
    found = (
        ("in equilibrium", _settled(model), 1e-7),
        (f"{steps * _STEP:g} s after a fall of 1 mm", fallen, 1e-4),
    )
    return [
        Row(
            f"{name}, {dim}D: force on the floor {when}",
            "m g",
            1.0,
            "its weight",
            -float(result.contacts["floor"].force[-1]) / weight,
            tolerance,
            "solved to 1e-8" if tolerance == 1e-7 else "still swinging a little",
        )
        for when, result, tolerance in found
    ]


def _depth_rows(dim: int, stiffnesses: list[float]) -> tuple[list[Row], Line]:
    """For a body that can only be deformed affinely, so that the penetration is uniform over its base."""
    body = affine_body(_mesh(dim), Stuff("stable_neo_hookean", _YOUNG, 0.0))
    width = float(np.ptp(body.mesh.points[:, 0]))
    row = _HEIGHT / (8 if dim == 2 else 6)
    # The lumped areas of the nodes of the base include half of the lowest cells of the sides.
    area = width + row if dim == 2 else width**2 + 2 * width * row
    base = body.mesh.points[:, -1] == 0.0
    rows, depths = [], []
    for stiffness in stiffnesses:
        model = _standing(REDUCED, body, stiffness)
        x, _ = nodal(model, _settled(model).state)
        depths.append(-float(x[base, -1].mean()))
        exact = float(np.sqrt(_PRESSURE * width ** (dim - 1) / (stiffness * area)))
        rows.append(
            Row(
                f"reduced, affine, {dim}D: depth at a stiffness of {stiffness:.0e} N/m^4",
                "mm",
                1e3 * exact,
                "m g = k A depth^2, A of the base and of half of the lowest cells of the sides",
                1e3 * depths[-1],
                1e3 * 1e-3 * exact,
                "the cut into simplices is not symmetric: it leans a little",
            )
        )
    return rows, Line(f"{dim}D", stiffnesses, depths)


def _shortening_row() -> Row:
    body = node_body(_mesh(2), Stuff("stable_neo_hookean", _YOUNG, 0.0))
    model = _standing(FULL, body, 1e12)
    x, _ = nodal(model, _settled(model).state)
    sunk = [float((body.mesh.points - x)[body.mesh.points[:, -1] == z, -1].mean()) for z in (0.0, _HEIGHT)]
    exact = DENSITY * _GRAVITY * _HEIGHT**2 / (2 * _YOUNG)
    return Row(
        f"{FULL}, 2D: shortening under its own weight, nu = 0",
        "mm",
        1e3 * exact,
        "rho g H^2/(2 E)",
        1e3 * (sunk[1] - sunk[0]),
        1e3 * 0.01 * exact,
        "1 %: nodes at the edges of the base have larger lumped areas than the rest, and the strain is finite, 0.5 %",
    )


def run(quick: bool) -> CaseResult:
    rows: list[Row] = []
    lines = []
    for dim in (2, 3):
        for name in BOTH:
            rows += _weight_rows(name, dim, 80)
    for dim in (2, 3):
        found, line = _depth_rows(dim, [1e8, 1e10] if quick else [1e8, 1e9, 1e10, 1e11, 1e12])
        rows += found
        lines.append(line)
    rows.append(_shortening_row())
    stiffness = np.asarray(lines[0].x)
    ideal = Line("fine mesh", stiffness, np.sqrt(_PRESSURE / stiffness), "reference")
    depth = Curve("Depth", "stiffness [N/m^4]", "depth [m]", (*lines, ideal), log=True)
    return CaseResult(tuple(rows), (depth,), _NOTES)


_NOTES = (
    "The lumped area of a node on an edge of the base includes the lowest cells of the side. So contact of a flat base "
    "is a little too stiff, by an area proportional to the cell size: the distance to the dashed line."
)

CASE = Case(
    name="resting",
    title="A block rests on a floor",
    statement=(
        "A block of jelly rests on a floor, without other supports. The floor has to carry its weight, in static "
        "equilibrium, and a few tens of steps after a drop, when it has come to rest. With the penalty it penetrates "
        "until k A depth^2 = m g. Its own weight shortens it by rho g H^2/(2 E)."
    ),
    sources=("Balance of forces; Hooke's law for a column under its weight.",),
    run=run,
)
