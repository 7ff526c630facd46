"""The framework of `softprint verify`: passing and failing rows, and that a failing case is reported and stops no
other."""

from __future__ import annotations

import argparse
import json
from dataclasses import replace

import pytest

pytest.importorskip("dolfinx")

import numpy as np

from softprint.fem_truth.verify import cases, table
from softprint.fem_truth.verify.case import Case, CaseResult, Curve, Line, Row
from softprint.fem_truth.verify.problems.simplex_rule import simplex_rule
from softprint.fem_truth.verify.suite import run_case, select
from softprint.fem_truth.verify.typeset import typeset
from softprint.fem_truth.verify.verify_verb import VERB
from softprint.runtime.cli.context import Context
from softprint.runtime.errors import SoftprintError
from softprint.runtime.inspect.kind import inspect_file

ROW = Row("stretch", "m", 2.0, "a book", 2.1, 0.2, "coarse")


def case(name, run):
    return Case(name, f"The {name} case", "What mu_L is.", ("A book.",), run)


def good(quick):
    line = Line("ours", [0.1, 0.2], [1e-3, 2e-3])
    return CaseResult((ROW,), (Curve("Errors", "size", "error", (line,), log=True),), "A note.")


def broken(quick):
    raise SoftprintError("the weather was bad")


def bug(quick):
    raise ZeroDivisionError("nothing to divide by")


@pytest.mark.parametrize(
    ("relation", "ours", "passed"),
    [
        ("=", 2.19, True),
        ("=", 2.21, False),
        ("=", float("nan"), False),
        ("<=", -5.0, True),
        ("<=", 2.3, False),
        ("<=", float("nan"), False),
        (">=", 9.0, True),
        (">=", 1.7, False),
        (">=", float("nan"), False),
    ],
)
def test_a_row_passes_within_its_tolerance_only(relation, ours, passed):
    assert replace(ROW, relation=relation, ours=ours).passed is passed


def test_errors_are_relative_unless_the_reference_is_zero():
    assert ROW.error == pytest.approx(0.05)
    assert ROW.allowed == pytest.approx(0.1)
    assert ROW.share == pytest.approx(0.5)
    assert replace(ROW, reference=0.0).error == pytest.approx(2.1)


def test_a_case_that_raises_is_a_failure_and_the_others_go_on(capsys):
    chosen = (case("good", good), case("broken", broken), case("bug", bug), case("last", good))
    outcomes = [run_case(each, quick=True) for each in chosen]
    assert [outcome.passed for outcome in outcomes] == [True, False, False, True]
    assert outcomes[1].failure == "the weather was bad"
    assert outcomes[2].failure == "ZeroDivisionError: nothing to divide by"
    assert "ZeroDivisionError" in capsys.readouterr().err  # a bug is shown with its traceback
    assert "did not finish: the weather was bad" in "\n".join(table.lines(outcomes[1]))
    assert table.summary(outcomes).startswith("2 of 4 cases passed, 2 of 2 numbers")


def test_cases_are_selected_by_name_in_the_order_of_the_suite():
    names = [case.name for case in cases.CASES]
    assert len(set(names)) == len(names)
    assert [case.name for case in select(cases.CASES, names[1::-1])] == names[:2]
    assert select(cases.CASES, []) == cases.CASES
    with pytest.raises(SoftprintError, match=r"no verification case 'cok'; there are: .*cook"):
        select(cases.CASES, ["cok"])


@pytest.mark.parametrize(("run", "status"), [(good, 0), (broken, 1)])
def test_the_command_prints_a_table_and_writes_a_self_contained_page(monkeypatch, tmp_path, run, status):
    monkeypatch.setattr(cases, "CASES", (case("sample", run),))
    said = []
    parser = argparse.ArgumentParser()
    VERB.configure(parser)
    options = parser.parse_args(["--quick", "--out", str(tmp_path)])
    assert VERB.run(options, Context(quiet=True, write=said.append)) == status
    text = "\n".join(said)
    assert "sample: The sample case" in text
    assert f"  {'passed' if status == 0 else 'FAILED'} in " in text
    page = (tmp_path / "verify.html").read_text()
    numbers = json.loads((tmp_path / "verify.json").read_text())
    facts = inspect_file(tmp_path / "verify.json").sections
    assert facts["verification"]["passed"] is (status == 0)
    assert "http" not in page.replace("http://www.w3.org", "")
    assert numbers["passed"] is (status == 0)
    if status == 0:
        assert '<data value="2.1">2.100</data>' in page
        assert numbers["cases"][0]["rows"][0]["ours"] == 2.1
        assert "<svg" in page
    else:
        assert "the weather was bad" in page
        assert facts["sample"] == {"did not finish": "the weather was bad"}


def test_list_runs_nothing(monkeypatch, tmp_path):
    monkeypatch.setattr(cases, "CASES", (case("bug", bug),))
    said = []
    parser = argparse.ArgumentParser()
    VERB.configure(parser)
    options = parser.parse_args(["--list", "--out", str(tmp_path / "none")])
    assert VERB.run(options, Context(write=said.append)) == 0
    assert said == [f"{'bug':<22} The bug case"]
    assert not (tmp_path / "none").exists()


def test_formulas_are_set_and_text_is_escaped():
    assert typeset("mu J^(-2/3) I_C") == "μ J<sup>−2/3</sup> I<sub>C</sub>"
    assert typeset("numbers of isochoric_neo_hookean") == "numbers of isochoric_neo_hookean"
    assert typeset("a < b & c") == "a &lt; b &amp; c"


@pytest.mark.parametrize("dim", [2, 3])
def test_simplex_rule_integrates_polynomials(dim):
    """integral of l_0^3 l_1^2 over a simplex of volume one = 3! 2! dim! / (5 + dim)!."""
    from math import factorial

    points, weights = simplex_rule(dim, 3)  # exact for degree 5
    np.testing.assert_allclose(points.sum(axis=1), 1.0, rtol=1e-14)
    for a, b in ((0, 1), (dim, 0), (1, dim)):
        found = weights @ (points[:, a] ** 3 * points[:, b] ** 2)
        assert found == pytest.approx(12 * factorial(dim) / factorial(5 + dim), rel=1e-13)
