"""Free uniaxial tension and simple shear of every material, against the published laws in principal stretches."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq

from softprint.fem_truth.elasticity.full_space_elasticity import FullSpaceElasticity
from softprint.fem_truth.verify.case import Case, CaseResult, Curve, Line, Row
from softprint.fem_truth.verify.problems.equilibrium import Solid, equilibrium, mean_first_piola
from softprint.runtime.arrays import Array
from softprint.runtime.elasticity.materials import Material, make_material
from softprint.runtime.elasticity.materials.invertible_neo_hookean import CONTINUED
from softprint.runtime.mesh import box_mesh

YOUNG, POISSON = 1e5, 0.46
MU, LAMBDA = YOUNG / (2 * (1 + POISSON)), YOUNG * POISSON / ((1 + POISSON) * (1 - 2 * POISSON))
BULK = LAMBDA + 2 / 3 * MU
_SHEAR = 0.5

Stress = Callable[[Array], Array]


def _stable(stretch: Array) -> Array:
    mu, lam, J = 4 / 3 * MU, LAMBDA + 5 / 6 * MU, stretch.prod()
    return mu * (1 - 1 / (stretch @ stretch + 1)) * stretch + (lam * (J - 1) - 3 / 4 * mu) * J / stretch


def _logarithmic(stretch: Array) -> Array:
    return MU * (stretch - 1 / stretch) + LAMBDA * np.log(stretch.prod()) / stretch


def _continued(stretch: Array) -> Array:
    J = stretch.prod()
    d = min(J / CONTINUED - 1.0, 0.0)
    log_J, slope = np.log(max(J, CONTINUED)) + d - d**2 / 2, (1.0 - d) / max(J, CONTINUED)
    return MU * stretch + (LAMBDA * log_J - MU) * slope * J / stretch


def _isochoric(stretch: Array) -> Array:
    J = stretch.prod()
    shape = MU * J ** (-2 / 3) * (stretch - stretch @ stretch / (3 * stretch))
    return shape + BULK / 2 * (J**2 - 1) / stretch


def _hooke(stretch: Array) -> Array:
    return 2 * MU * (stretch - 1) + LAMBDA * (stretch - 1).sum()


@dataclass(frozen=True)
class Law:
    """A published law: its name here, its source, principal first Piola stresses [Pa] at principal stretches
    (3,), and P_12 and P_11 [Pa] in simple shear F = I + gamma e_1 (x) e_2 as functions of gamma."""

    model: str
    label: str
    source: str
    principal: Stress
    across: Callable[[float], float]
    along: Callable[[float], float]


_LAWS = (
    Law(
        "stable_neo_hookean",
        "stable",
        "Smith, de Goes, Kim 2018, eq. 14, mu = 4/3 mu_L, lambda = lambda_L + 5/6 mu_L",
        _stable,
        lambda g: 4 / 3 * MU * (1 - 1 / (4 + g**2)) * g,
        lambda g: 4 / 3 * MU * g**2 / (4 * (4 + g**2)),
    ),
    Law(
        "neo_hookean",
        "logarithmic",
        "Bonet and Wood 1997, sec. 6.4.3: P = mu (F - F^-T) + lambda log J F^-T",
        _logarithmic,
        lambda g: MU * g,
        lambda g: 0.0,
    ),
    Law(
        "invertible_neo_hookean",
        "logarithmic, continued",
        "the same with log J continued below J = 0.3, in the way of Stomakhin et al. 2012",
        _continued,
        lambda g: MU * g,
        lambda g: 0.0,
    ),
    Law(
        "isochoric_neo_hookean",
        "isochoric",
        "Simo and Miehe 1992: P = mu J^(-2/3) (F - I_C/3 F^-T) + kappa/2 (J^2 - 1) F^-T",
        _isochoric,
        lambda g: MU * g,
        lambda g: -MU * g**2 / 3,
    ),
    Law("linear", "linear", "Hooke's law", _hooke, lambda g: MU * g, lambda g: 0.0),
)
# Computed independently of this code, to nine digits.
_PUBLISHED = {2.0: (0.71971603, 66327.2507), 0.5: (1.34841608, -113907.988)}


def free_bar(law: Law, stretch: float) -> tuple[float, float]:
    """Lateral stretch, and axial P [Pa], by the root of the lateral stress."""

    def stress(lateral: float) -> Array:
        return law.principal(np.array([stretch, lateral, lateral]))

    lateral = float(brentq(lambda a: stress(a)[1], 0.2, 3.0, xtol=1e-15))
    return lateral, float(stress(lateral)[0])


def _kernel_bar(material: Material, stretch: float) -> tuple[float, float]:
    """The same with the stress of the runtime."""

    def stress(lateral: float) -> Array:
        return np.asarray(material.first_piola(np.diag([stretch, lateral, lateral])[None])[0])

    lateral = float(brentq(lambda a: stress(a)[1, 1], 0.2, 3.0, xtol=1e-15))
    return lateral, float(stress(lateral)[0, 0])


class _Block:
    """A cube of 48 tetrahedra in DOLFINx, one node of them inside."""

    def __init__(self, material: Material) -> None:
        self._mesh = box_mesh([0.0] * 3, [1.0] * 3, [2] * 3)
        self._elasticity = FullSpaceElasticity(Solid(self._mesh, material))

    def pulled(self, stretch: float) -> tuple[float, float]:
        """Rollers on three faces, the fourth displaced, the others free: mean lateral stretch, and axial P [Pa]."""
        points = self._mesh.points
        held = points == 0.0
        held[:, 0] |= points[:, 0] == 1.0
        x = equilibrium(self._elasticity, held, points * [stretch, 1.0, 1.0], tolerance=1e-11)
        side = points[:, 1] == 1.0
        return float(x[side, 1].mean()), float(self._stress(x)[0, 0])

    def sheared(self, amount: float) -> tuple[float, float]:
        """The whole surface displaced to x + gamma y e_1, the interior free: P_12 and P_11 [Pa]."""
        points = self._mesh.points
        held = np.zeros(points.shape, dtype=bool)
        held[self._mesh.surface_nodes] = True
        start = points.copy()
        start[self._mesh.surface_nodes, 0] += amount * points[self._mesh.surface_nodes, 1]
        stress = self._stress(equilibrium(self._elasticity, held, start, tolerance=1e-11))
        return float(stress[0, 1]), float(stress[0, 0])

    def _stress(self, x: Array) -> Array:
        return mean_first_piola(self._mesh, self._elasticity.gradient(x))


def _farther(reference: float, *ours: float) -> float:
    return max(ours, key=lambda value: abs(value - reference))


def _bar_rows(law: Law, material: Material, block: _Block) -> list[Row]:
    rows = []
    for stretch in (2.0, 0.5):
        lateral, stress = free_bar(law, stretch)
        source = f"{law.source}; root of the lateral stress"
        if law.model == "stable_neo_hookean":
            (lateral, stress), source = _PUBLISHED[stretch], f"{law.source}; known to nine digits"
        kernel, solved = _kernel_bar(material, stretch), block.pulled(stretch)
        why = "nine digits are known, and the block is in equilibrium to 1e-11"
        at = f"at stretch {stretch:g}"
        rows += [
            Row(
                f"{law.label}: lateral stretch {at}",
                "",
                lateral,
                source,
                _farther(lateral, kernel[0], solved[0]),
                1e-8 * max(lateral, 1.0),
                why,
            ),
            Row(
                f"{law.label}: P11 {at}",
                "Pa",
                stress,
                source,
                _farther(stress, kernel[1], solved[1]),
                1e-8 * abs(stress),
                why,
            ),
        ]
    return rows


def _shear_rows(law: Law, material: Material, block: _Block) -> list[Row]:
    F = np.eye(3)
    F[0, 1] = _SHEAR
    kernel, solved = material.first_piola(F[None])[0], block.sheared(_SHEAR)
    rows = []
    for name, reference, ours in (
        ("P12", law.across(_SHEAR), (float(kernel[0, 1]), solved[0])),
        ("P11", law.along(_SHEAR), (float(kernel[0, 0]), solved[1])),
    ):
        rows.append(
            Row(
                f"{law.label}: {name} at a shear of {_SHEAR:g}",
                "Pa",
                reference,
                f"{law.source}; written out for F = I + gamma e1 (x) e2, where J = 1",
                _farther(reference, *ours),
                1e-9 * MU,
                "1e-9 of the shear modulus: equilibrium to 1e-11, and round-off",
            )
        )
    return rows


def _small_strain_rows(law: Law, material: Material, block: _Block) -> list[Row]:
    rows, strain = [], 1e-5
    measured = [bar(1 + strain) for bar in (lambda s: _kernel_bar(material, s), block.pulled)]
    for name, unit, reference, ours in (
        ("E", "Pa", YOUNG, [stress / strain for _, stress in measured]),
        ("nu", "", POISSON, [(1 - lateral) / strain for lateral, _ in measured]),
    ):
        rows.append(
            Row(
                f"{law.label}: {name} at a strain of 1e-5",
                unit,
                reference,
                "the modulus that the material was made with",
                _farther(reference, *ours),
                1e-4 * reference,
                "required; the laws bend by about the strain itself",
            )
        )
    return rows


def run(quick: bool) -> CaseResult:
    """The quick run is the same: it takes a second or two."""
    rows: list[Row] = []
    lines = []
    stretches = np.linspace(0.4, 2.5, 43)
    for law in _LAWS:
        material = make_material(law.model, YOUNG, POISSON)
        block = _Block(material)
        rows += _bar_rows(law, material, block)
        rows += _shear_rows(law, material, block)
        rows += _small_strain_rows(law, material, block)
        stress = [
            _kernel_bar(material, float(stretch))[1] / 1e3 for stretch in stretches if law.model != "linear"
        ]
        if stress:
            exact = [free_bar(law, float(stretch))[1] / 1e3 for stretch in stretches]
            lines += [Line(law.label, stretches, stress, "dots"), Line("", stretches, exact, "reference")]
    curve = Curve("Free bar: ours (dots), closed forms (dashed)", "stretch", "P11 [kPa]", tuple(lines))
    return CaseResult(tuple(rows), (curve,), _NOTES)


_NOTES = (
    "Every number is that of the runtime's kernels or of the finite-element block, whichever is farther from the "
    "reference."
)

CASE = Case(
    name="closed_forms",
    title="Closed forms of every material",
    statement=(
        "A bar of E = 100 kPa and nu = 0.46 is stretched to twice and compressed to half of its length, its sides "
        "free; a cube is sheared by 0.5; a bar is stretched by 1e-5, which has to reproduce E and nu. The references "
        "are the published laws as principal stresses P_i of the principal stretches l_i, with the lateral stretch the "
        "root of P_2 = 0; in simple shear everything is explicit, because J = 1.\n\n"
        "Ours is computed twice: with the stress kernels of the runtime, and from the nodal forces of a block of 48 "
        "tetrahedra in equilibrium, whose forms are differentiated and compiled by UFL and FFCx: "
        "mean P = 1/V sum_i f_i (x) X_i."
    ),
    sources=(
        "B. Smith, F. de Goes, T. Kim, Stable Neo-Hookean Flesh Simulation, ACM Transactions on Graphics 37(2), 2018.",
        "J. Bonet, R. D. Wood, Nonlinear Continuum Mechanics for Finite Element Analysis, 1997.",
        "J. C. Simo, C. Miehe, Associative coupled thermoplasticity at finite strains, CMAME 98, 1992.",
    ),
    run=run,
)
