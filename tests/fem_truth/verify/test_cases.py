"""The quick run of every static verification case, and that the suite can fail: a wrong law does not pass."""

from __future__ import annotations

import pytest

pytest.importorskip("dolfinx")

from softprint.fem_truth.verify.cases import (
    closed_forms,
    condensed_contact,
    constrained,
    cook,
    hertz,
    independent_library,
    manufactured_solutions,
)
from softprint.fem_truth.verify.problems.import_witness import import_witness
from softprint.runtime.contact.learned_energy.learned_energy import LearnedEnergy
from softprint.runtime.elasticity.materials import make_material
from softprint.runtime.errors import SoftprintError

NEED_SCIKIT_FEM = (cook.CASE, independent_library.CASE, constrained.CASE)
STATICS = (
    closed_forms.CASE,
    manufactured_solutions.CASE,
    hertz.CASE,
    condensed_contact.CASE,
    *NEED_SCIKIT_FEM,
)


@pytest.mark.parametrize("case", STATICS, ids=lambda case: case.name)
def test_quick(case):
    if case in NEED_SCIKIT_FEM:
        pytest.importorskip("skfem")
    result = case.run(True)
    assert result.rows
    failed = [
        f"{row.quantity}: {row.ours} instead of {row.reference}" for row in result.rows if not row.passed
    ]
    assert failed == []


def test_a_modulus_wrong_by_one_part_in_a_million_fails(monkeypatch):
    monkeypatch.setattr(
        closed_forms,
        "make_material",
        lambda model, young, poisson: make_material(model, 1.000001 * young, poisson),
    )
    rows = closed_forms.run(True).rows
    assert {row.quantity for row in rows if not row.passed} >= {
        "stable: P11 at stretch 2",
        "isochoric: P12 at a shear of 0.5",
    }


def test_a_law_other_than_that_of_the_force_does_not_converge(monkeypatch):
    monkeypatch.setattr(
        manufactured_solutions,
        "make_material",
        lambda model, young, poisson: make_material("stable_neo_hookean", young, poisson),
    )
    monkeypatch.setattr(manufactured_solutions, "_QUICK", manufactured_solutions._QUICK[:1])
    assert not any(row.passed for row in manufactured_solutions.run(True).rows[:1])


def test_forces_that_are_not_the_derivative_of_the_learned_energy_fail(monkeypatch):
    terms = LearnedEnergy.terms

    def steeper(learned, energy, *measures):
        found = terms(learned, energy, *measures)
        return found._replace(slope=1.001 * found.slope)

    monkeypatch.setattr(LearnedEnergy, "terms", steeper)
    failed = {row.quantity for row in condensed_contact.run(True).rows if not row.passed}
    assert {"2D, learned: force on the ball", "2D, learned: slope along the handles"} <= failed
    assert not any("mechanics" in quantity for quantity in failed)


def test_a_contact_that_is_stiffer_by_a_part_in_a_thousand_fails(monkeypatch):
    pytest.importorskip("skfem")
    monkeypatch.setattr(constrained, "PenaltyContact", lambda k, **rest: _PENALTY(1.001 * k, **rest))
    rows = constrained._compare(2, 4, True)
    assert [row.passed for row in rows] == [True, False]


_PENALTY = constrained.PenaltyContact


def test_without_scikit_fem_a_case_says_so(monkeypatch):
    monkeypatch.setattr("softprint.fem_truth.verify.problems.import_witness.find_spec", lambda name: None)
    with pytest.raises(SoftprintError, match="needs scikit-fem, which is not installed"):
        import_witness()
