"""Output files of training and benchmarks in a run directory, as tables."""

import json

import pytest

pytest.importorskip("torch")

from softprint.fem_truth.report.measurements.learning import Learning, load_learning, read_curves, read_table
from softprint.runtime.errors import SoftprintError
from softprint.runtime.learned.correction_file import CorrectionHeader


def test_a_table_from_records_and_from_a_bench(tmp_path):
    path = tmp_path / "t.json"
    path.write_text(json.dumps([{"option": "none", "error": 0.4}, {"option": "sdf", "seconds": 3}]))
    assert read_table(path) == {
        "columns": ["option", "error", "seconds"],
        "rows": [
            {"option": "none", "error": 0.4, "seconds": None},
            {"option": "sdf", "error": None, "seconds": 3},
        ],
    }
    path.write_text(json.dumps({"scene": "x", "speeds": [{"model": "bare", "phases": {"solve": 1e-3}}]}))
    bench = read_table(path)
    assert bench["rows"] == [{"model": "bare", "phases solve": 1e-3}]
    assert bench["conditions"]["scene"] == "x"
    assert bench["conditions"]["tolerance"] is None  # written before bench recorded it


@pytest.mark.parametrize("content", ["{", "[]", "3", '{"rows": 3}', "[1, 2]"])
def test_a_file_without_a_table_is_refused_by_name(tmp_path, content):
    path = tmp_path / "ablation.json"
    path.write_text(content)
    with pytest.raises(SoftprintError, match=r"ablation\.json"):
        load_learning({}, tmp_path)


def test_held_out_states_are_read_from_header_and_curves():
    header = CorrectionHeader(
        name="ours",
        collider="ball",
        body_hash="",
        truth_hash="",
        dim=2,
        n_rows=9,
        form="force",
        mechanics_hash="",
        options={},
        held_out_rms=0.2,
        training={"seconds": 3.0, "samples": 80},
        provenance={},
    )
    curves = {"held_out": {"rms": 0.2, "worst": 1.1, "samples": 20}, "history": []}
    known = Learning({"ours": header}, {"ours": curves}).summary()["held_out_states"]["ours"]
    assert known == {
        "rms": 0.2,
        "squared": pytest.approx(0.04),
        "worst": 1.1,
        "samples": 80,
        "validation_samples": 20,
        "seconds": 3.0,
    }
    without_curves = Learning({"ours": header}).summary()["held_out_states"]["ours"]
    assert without_curves["samples"] == 80
    assert without_curves["worst"] is None


@pytest.mark.parametrize(
    "content",
    [
        "[]",
        "{}",
        '{"history": 3}',
        '{"history": [{"step": 1}]}',
        '{"history": [{"step": 1, "loss": "low", "validation_rms": 1}]}',
        '{"history": [], "held_out": 3}',
    ],
)
def test_a_file_without_curves_is_refused_by_name(tmp_path, content):
    path = tmp_path / "ours.json"
    path.write_text(content)
    with pytest.raises(SoftprintError, match=r"ours\.json: does not contain training curves"):
        read_curves(path)


def test_an_empty_run_has_no_corrections(tmp_path):
    learning = load_learning({}, tmp_path)
    assert learning.histories == {}
    assert learning.summary()["ablation"] is None
    assert learning.summary()["benchmarks"] == []
