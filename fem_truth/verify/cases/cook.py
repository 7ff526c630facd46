"""Cook's membrane at finite strain: the published result, plane strain, and nearly incompressible."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from softprint.fem_truth.verify.case import Case, CaseResult, Curve, Line, Row
from softprint.fem_truth.verify.problems import cook
from softprint.runtime.arrays import Array

_PUBLISHED = 14.33  # mm
# Elements along an edge and the rise of the corner [mm] in the published table, quadratic hexahedra.
_PUBLISHED_CELLS = (1, 2, 4, 8, 16, 32)
_PUBLISHED_RISES = np.array([12.19, 13.83, 14.22, 14.30, 14.32, 14.33])
_DEALII = (
    "deal.II code gallery, Quasi-Static Finite-Strain Compressible Elasticity: quadratic hexahedra, converged"
)
_WITNESS = "scikit-fem with Taylor and Hood's quadrilaterals (displacement and pressure), the law written out by hand"
_SOFT, _HARD = 0.3, 0.4999  # Poisson's ratios


def run(quick: bool) -> CaseResult:
    """A quick run has meshes half as fine, with larger tolerances."""
    free_cells, plane_cells, linear_cells, hard_cells = (
        ((2, 4, 8), (2, 4, 8), (8, 16, 32), (4, 8))
        if quick
        else ((2, 4, 8, 16), (4, 8, 16), (8, 16, 32, 64), (4, 8, 16, 32))
    )
    free = [cook.free_faces(_SOFT, 2, count) for count in free_cells]
    quadratic = [cook.plane_strain(_SOFT, 2, count) for count in plane_cells]
    linear = [cook.softprint(_SOFT, count) for count in linear_cells]
    locked = [cook.softprint(_HARD, count) for count in hard_cells]
    remedied = [cook.plane_strain(_HARD, 2, count) for count in hard_cells]
    soft, hard = (cook.witness(poisson, 4 if quick else 8) for poisson in (_SOFT, _HARD))
    coarse = "the requirement is 0.5 %, and the quick meshes are coarser"
    rows = (
        _row(
            "free faces, P2", _PUBLISHED, _DEALII, free, *((0.01, coarse) if quick else (0.005, "required"))
        ),
        _row(
            "plane strain, P2",
            soft,
            _WITNESS,
            quadratic,
            *((0.01, coarse) if quick else (0.005, "required")),
        ),
        _row(
            "plane strain, Softprint's P1 solver",
            soft,
            _WITNESS,
            linear,
            *(
                (0.025, coarse)
                if quick
                else (0.01, "linear elements need a mesh four times as fine as quadratic ones")
            ),
        ),
        Row(
            "nu = 0.4999, P1: rise of the corner, which locks",
            "mm",
            0.5 * hard,
            f"half of the result of {_WITNESS}",
            locked[-1],
            0.0,
            "none, for this is a bound",
            relation="<=",
        ),
        _row(
            "nu = 0.4999, P2",
            hard,
            _WITNESS,
            remedied,
            *(
                (0.12, "two coarse meshes")
                if quick
                else (0.025, "quadratic elements do not lock, but converge slowly here")
            ),
        ),
    )
    curves = (
        _curve(
            "nu = 0.3, faces free",
            [("P2", free_cells, free)],
            ("deal.II's quadratic hexahedra", _PUBLISHED_CELLS, _PUBLISHED_RISES),
        ),
        _curve(
            "nu = 0.3, plane strain",
            [("P2", plane_cells, quadratic), ("P1, Softprint's own solver", linear_cells, linear)],
            ("scikit-fem, mixed", linear_cells, np.full(len(linear_cells), soft)),
        ),
        _curve(
            "nu = 0.4999, plane strain",
            [("P2", hard_cells, remedied), ("P1", hard_cells, locked)],
            ("scikit-fem, mixed", hard_cells, np.full(len(hard_cells), hard)),
        ),
    )
    return CaseResult(rows, curves, _NOTES)


def _row(
    what: str, reference: float, source: str, found: Sequence[float], tolerance: float, reason: str
) -> Row:
    order = None
    if len(found) > 2:  # each mesh is twice as fine as the one before
        order = float(np.log2((found[-2] - found[-3]) / (found[-1] - found[-2])))
    name = f"{what}: rise of the corner"
    return Row(name, "mm", reference, source, found[-1], tolerance * reference, reason, order)


def _curve(
    title: str,
    ours: Sequence[tuple[str, Sequence[int], Sequence[float]]],
    other: tuple[str, Sequence[float] | Array, Array],
) -> Curve:
    lines = [Line(label, cells, np.array(rises)) for label, cells, rises in ours]
    label, cells, rises = other
    return Curve(
        title,
        "cells along an edge",
        "rise of the corner [mm]",
        (*lines, Line(label, cells, rises, "reference")),
    )


_NOTES = (
    "The published program is intended to be in plane strain. It selects the faces by the x coordinate of their "
    "centres instead of z, finds none, and leaves them free: its 14.33 mm, with one layer of cells and a symmetric "
    "mesh, are those of a membrane with free faces. The first row computes this case, on half of the thickness. In "
    "plane strain the corner rises by 13.77 mm, which a second library confirms."
)

CASE = Case(
    name="cook",
    title="Cook's membrane",
    statement=(
        "A panel with the corners (0, 0), (48, 44), (48, 60), (0, 44) mm, 1 mm thick, is clamped on the left "
        "and sheared upward by 1 N, spread evenly over the right edge. Its energy is mu/2 (tr b_iso - 3) + "
        "kappa/4 (J^2 - 1 - 2 log J) with mu = 422.5 kPa. The result is the rise of the upper right corner at nu "
        "= 0.3, and at nu = 0.4999, where linear elements lock and quadratic ones do not."
    ),
    sources=(
        "J.-P. Pelteret, A. McBride, The deal.II code gallery: Quasi-Static Finite-Strain Compressible "
        "Elasticity, 2016, doi:10.5281/zenodo.1228964.",
        "R. D. Cook, Improved two-dimensional finite element, Journal of the Structural Division 100, 1974.",
        "T. Gustafsson, G. D. McBain, scikit-fem: A Python package for finite element assembly, JOSS 5(52), 2020.",
    ),
    run=run,
)
