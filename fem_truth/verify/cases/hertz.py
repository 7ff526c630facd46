"""Hertz's contact: force, radius and pressure of a rigid ball on an elastic half-space."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from softprint.fem_truth.verify.case import Case, CaseResult, Curve, Line, Row
from softprint.fem_truth.verify.problems.hertz import Hertz, Pressed, press
from softprint.runtime.arrays import Array

SOFT = Hertz(young=2e4, poisson=0.4, radius=0.03, approach=3e-4)
#: Two equal balls of R = 2, pressed by 1e4 N, approach by 0.01 with a contact radius of 0.1: half of that is one of
#: them on a rigid plane, and by Hertz's theory as well a rigid ball of that radius on a half-space of its material.
MOOSE = Hertz(young=1.40625e7, poisson=0.25, radius=2.0, approach=0.005)
_MOOSE_FORCE, _MOOSE_RADIUS = 1e4, 0.1

_HARD = 1e-3  # penetration as a share of the approach, so small that the penalty has no visible effect
_HERTZ = "Hertz 1882 (Johnson 1985, sec. 4.2)"
_MOOSE = "the MOOSE framework's set for Hertzian contact of two balls, halved"


def run(quick: bool) -> CaseResult:
    """A quick run is half as fine, with twice the tolerance of forces."""
    cells = (3, 4) if quick else (3, 4, 6, 8)
    allowed = 0.06 if quick else 0.03
    why = "twice the requirement, on a mesh half as fine" if quick else "required"
    found = [press(SOFT, count, _HARD) for count in cells]
    rows = [
        _force_row("rigid ball", SOFT.force, f"{_HERTZ}: 4/3 E* sqrt(R) d^(3/2)", found[-1], allowed, why),
        _radius_row("rigid ball", SOFT.contact_radius, f"{_HERTZ}: sqrt(R d)", found[-1], cells[-1]),
    ]
    errors = np.array([abs(result.force / SOFT.force - 1.0) for result in found])
    first, last = (0, 1) if quick else (1, 3)
    rows.append(_mesh_row(errors[first], errors[last], cells[last] / cells[first], quick))

    penetrations = np.array([0.08, 0.04, 0.02, 0.01])
    forces = np.array([press(SOFT, cells[0], share).force for share in penetrations])
    rows.append(_penalty_row(forces))

    witness = press(MOOSE, cells[-2], _HARD)
    rows += [
        _force_row("MOOSE's set", _MOOSE_FORCE, _MOOSE, witness, allowed, why),
        _radius_row("MOOSE's set", _MOOSE_RADIUS, _MOOSE, witness, cells[-2]),
    ]
    hardest = press(SOFT, cells[0], _HARD).force if quick else found[0].force
    return CaseResult(
        tuple(rows),
        (
            _pressure_curve(found[-1]),
            _mesh_curve(np.array(cells), errors),
            _penalty_curve(penetrations, np.abs(forces / hardest - 1.0)),
        ),
        "Linear elements are too stiff, so that forces decrease to Hertz's as the mesh is refined; a soft "
        "penalty lets the ball penetrate, which lowers them. The radius is that of Hertz's pressure with the "
        "computed second moment: a^2 = 5/2 sum f_i r_i^2 / sum f_i.",
    )


def _force_row(what: str, reference: float, source: str, found: Pressed, allowed: float, why: str) -> Row:
    return Row(f"{what}: force", "N", reference, source, found.force, allowed * reference, why)


def _radius_row(what: str, reference: float, source: str, found: Pressed, cells: int) -> Row:
    tolerance = reference / cells
    return Row(
        f"{what}: contact radius", "m", reference, source, found.contact_radius, tolerance, "one element"
    )


def _mesh_row(coarse: float, fine: float, finer: float, quick: bool) -> Row:
    order = float(np.log(coarse / fine) / np.log(finer))
    return Row(
        "order of the force in the cell size",
        "",
        1.0,
        "linear elements: first order in the energy norm, and the force is the derivative of an energy",
        order,
        0.5 if quick else 0.0,
        "the coarsest meshes are too coarse for a clean order" if quick else "none, for this is a bound",
        order,
        ">=",
    )


def _penalty_row(forces: Array) -> Row:
    """forces: at penetrations halved from one to the next."""
    order = float(np.log2((forces[2] - forces[1]) / (forces[3] - forces[2])))
    return Row(
        "order of the force in the penetration",
        "",
        1.0,
        "pressure = k penetration^2; penetration by s acts like an approach that is smaller by about s",
        order,
        0.15,
        "the next term of the expansion",
        order,
    )


def _pressure_curve(found: Pressed) -> Curve:
    scale, peak = SOFT.contact_radius, SOFT.peak_pressure
    near = found.radii < 1.3 * scale
    order = np.argsort(found.radii[near])
    r = np.linspace(0.0, 1.0, 101)
    return Curve(
        "Pressure under the ball",
        "r / a",
        "p / p0",
        (
            Line(
                "nodes of ours", found.radii[near][order] / scale, found.pressures[near][order] / peak, "dots"
            ),
            Line("Hertz", np.append(r, 1.3), np.append(np.sqrt(1.0 - r**2), 0.0), "reference"),
        ),
    )


def _mesh_curve(cells: Array, errors: Array) -> Curve:
    guide = errors[-1] * cells[-1] / cells
    return Curve(
        "Force and mesh",
        "cell size / a",
        "error of the force",
        (Line("ours", 1.0 / cells, errors), Line("first order", 1.0 / cells, guide, "reference")),
        log=True,
    )


def _penalty_curve(penetrations: Array, errors: Array) -> Curve:
    guide: Sequence[float] | Array = 1.5 * penetrations
    return Curve(
        "Force and penalty, on the coarsest mesh",
        "penetration / approach",
        "force missing",
        (
            Line("ours", penetrations, errors),
            Line("3/2 of the penetration", penetrations, guide, "reference"),
        ),
        log=True,
    )


CASE = Case(
    name="hertz",
    title="Hertz's contact",
    statement=(
        "A rigid ball is pressed into a half-space of small-strain elasticity: F = 4/3 E* sqrt(R) d^(3/2), a = "
        "sqrt(R d), E* = E / (1 - nu^2), with the approach d a hundredth of R (E = 20 kPa, nu = 0.4, R = 30 "
        "mm).\n\n"
        "Ours is a quarter of a block of edge 8 a, with planes of symmetry, Softprint's penalty contact of the "
        "surface nodes, and its minimiser. The outer faces are displaced as in Boussinesq's half-space under the "
        "computed force, never the expected one. The penalty is given by the penetration at the peak pressure, as a "
        "share of d; forces and radii are shown for a share of 0.001."
    ),
    sources=(
        "K. L. Johnson, Contact Mechanics, 1985, sections 3.2 and 4.2.",
        "MOOSE framework, contact module, Hertzian contact of two balls: R = 2, E = 1.40625e7, nu = 0.25, F = "
        "1e4 give a contact radius of 0.1 and an approach of 0.01.",
    ),
    run=run,
)
