"""The page: its numbers are those of the JSON, it is self-contained, and numbers are readable."""

import json
import re

import numpy as np
import pytest

pytest.importorskip("jinja2")
pytest.importorskip("matplotlib")

from softprint.fem_truth.report.drawing import figures
from softprint.fem_truth.report.drawing.picture import encode
from softprint.fem_truth.report.drawing.style import styles_for
from softprint.fem_truth.report.drawing.worst_pictures import worst_pictures
from softprint.fem_truth.report.headline import console_lines, headline_cards
from softprint.fem_truth.report.page import (
    PageContent,
    ScenePictures,
    ShapeView,
    ShownFrame,
    format_number,
    look_up,
    render_page,
)
from softprint.fem_truth.report.report_json import json_text, plain
from tests.page_reader import Reader

MODELS = ("full", "bare", "linear_response", "thesis5", "ours", "truth", "statics", "v1.2 <odd>")


def error_rows(models):
    names = [
        "relative_rms",
        "relative_rms_squared",
        "relative_median",
        "relative_worst",
        "relative_near_contact",
        "rms",
        "worst_node",
        "max_penetration",
        "mean_penetration",
    ]
    rng = np.random.default_rng(1)
    return {
        model: {
            **dict(zip(names, rng.uniform(1e-4, 1.2, len(names)))),
            "worst_frame": 3,
            "inverted_frames": 2,
            "worse_frames": 1,
            "n_frames": 9,
        }
        for model in models
    }


def phase_row(step, phases):
    return {
        "step": step,
        "p95": 1.9 * step,
        "median": 0.8 * step,
        "steps_per_second": 1 / step,
        "faster_than_full": 0.05 / step,
        "cost_of_bare": None,
        "iterations": 3.25,
        "converged": 0.995,
        "phases": phases,
    }


@pytest.fixture
def summary():
    timings = {
        "full": phase_row(0.05, {"other": 0.05}),
        "ours": phase_row(0.007, {"elastic": 0.004, "other": 0.003}),
    }
    scene = {
        "name": "held out & strange <name>",
        "n_frames": 40,
        "n_contact": 9,
        "n_left_out": 3,
        "n_solved": 4,
        "errors_all": error_rows(("full", "bare", "thesis5", "ours", "v1.2 <odd>")),
        "errors_solved": error_rows(MODELS),
        "contact_displacement": {"bare": 1.0, "ours": 0.213},
        "unsolved": [{"frame": 7, "reason": "constrained truth: the line search failed"}],
        "plotted": ["bare", "ours"],
        "free": {
            "ours": {
                "rms": 1e-3,
                "relative": None,
                "largest": 2e-3,
                "last": 1e-4,
                "max_penetration": 1e-3,
                "not_converged": 2,
                "invalid": 1,
            }
        },
        "shown": [
            {
                "frame": 11,
                "time": 0.183,
                "why": "deepest contact",
                "depth": 0.0083,
                "heat_limit": 0.004,
                "relative": {"ours": 0.4},
            }
        ],
    }
    content = {
        "softprint_report": 1,
        "made": "2026-01-01 00:00 UTC",
        "experiment": {
            "name": "toy",
            "seed": 7,
            "friction": 0.3,
            "text": '[experiment]\nname = "<b>toy</b>"',
        },
        "body": {
            "dim": 3,
            "nodes": 2431,
            "cells": 9649,
            "surface_nodes": 1800,
            "size": 0.1,
            "material": "soft",
            "points": 18,
            "frames": 1,
            "rows": 22,
            "dofs": 60,
            "hold": "mass",
            "cubature": 220,
            "contact_points": 1800,
        },
        "collider": {"name": "pointy", "shape": "mesh", "size": 0.032},
        "machine": {"processor": "a CPU", "cores": 2, "memory": 6 * 2**30, "threads": "1", "system": "an OS"},
        "versions": {"python": "3.11"},
        "files": [{"name": "body.h5", "bytes": 123456, "hash": "ab" * 32}],
        "notes": ["Something is missing."],
        "errors": error_rows(("full", "bare", "thesis5", "ours")),
        "errors_solved": error_rows(MODELS),
        "contact_displacement": {"bare": 1.0, "linear_response": 0.3, "thesis5": 0.4, "ours": 0.213},
        "scenes": [scene],
        "timings": timings,
        "phases": ["other", "elastic"],
        "truth": {
            "samples": 8000,
            "contacts": 1600,
            "states": 5,
            "refused": 1,
            "converged": 7900,
            "seconds_per_sample": 0.3,
            "noise_floor": 0.012,
            "noise_90": 0.05,
            "flagged": 12,
            "pierced": 4,
            "inverted": 1,
            "usable": 7800,
            "repeats": 240,
            "statuses": {"converged": {"count": 7900, "share": 0.9875}},
        },
        "training": {},
        "corrections": {},
        "held_out_states": {
            "ours": {
                "rms": 0.2,
                "squared": 0.04,
                "worst": None,
                "samples": 10,
                "validation_samples": 3,
                "seconds": 4.0,
            }
        },
        "ablation": {"columns": ["option", "error"], "rows": [{"option": "none", "error": 0.3}]},
        "benchmarks": [{"name": "bench", "columns": ["cells", "ms"], "rows": [{"cells": 15000, "ms": 3.5}]}],
    }
    cards = [vars(card) for card in headline_cards(content, "ours", styles_for(MODELS))]
    content["headline"] = {"model": "ours", "cards": cards, "hero_caption": "The deepest contact."}
    return plain(content)


@pytest.fixture
def page(summary):
    styles = styles_for(MODELS)
    picture = encode(np.full((6, 8, 4), 200, dtype=np.uint8), 'a "quoted" picture')
    curve = figures.over_time("error0", [0.0, 0.1], {"bare": [1.0, 2.0], "ours": [0.5, 0.7]}, styles, "mm")
    shown = ShownFrame(
        0, 11, "deepest contact", ("full", "ours"), [picture] * 2, [None, None], [None, picture]
    )
    scene = summary["scenes"][0]["name"]
    plots = {
        "phases": figures.phases("phases", {"ours": {"elastic": 4.0, "other": 3.0}}, styles),
        "quality": figures.histograms("quality", {"residual": [1e-5, 3e-3, 1e-4], "iterations": [3, 4, 4]}),
    }
    scenes = {scene: ScenePictures({"error": curve}, [shown], "Drawn.")}
    return render_page(PageContent(summary, scenes, plots, styles, [("ours", picture)]))


def test_every_number_is_the_one_in_the_json(page, summary):
    reader = Reader()
    reader.feed(page)
    stored = json.loads(json_text(summary))
    assert len(reader.numbers) > 150
    for key, value in reader.numbers:
        assert float(value) == look_up(stored, key), key
    keys = {key for key, _ in reader.numbers}
    assert "scenes/0/errors_all/ours/relative_rms" in keys
    assert "scenes/0/errors_solved/v1.2 <odd>/relative_rms" in keys
    assert "timings/ours/phases/elastic" in keys


def test_it_is_self_contained(page):
    reader = Reader()
    reader.feed(page)
    assert all(link.startswith(("data:", "#")) for link in reader.loads), reader.loads
    assert not reader.tags & {"script", "link", "iframe", "object", "embed"}
    assert "@import" not in page
    assert all(target.startswith("#") for target in re.findall(r"url\(['\"]?([^)]*)", page))
    assert "http" not in page.replace("http-equiv", "")
    assert reader.missing_alt == 0


def test_names_and_texts_are_escaped(page):
    assert "<b>toy</b>" not in page
    assert "&lt;b&gt;toy" in page
    assert "held out &amp; strange &lt;name&gt;" in page


def test_ids_are_unique_and_references_have_targets(page):
    ids = re.findall(r'\bid="([^"]+)"', page)
    assert len(ids) == len(set(ids))
    assert set(re.findall(r'href="#([^"]+)"', page)) <= set(ids)


def test_svg_takes_its_colours_from_the_page():
    svg = figures.over_time(
        "x", [0.0, 1.0], {"ours": [1.0, 2.0]}, styles_for(["ours"]), "mm", depth=[0.0, 1.0]
    )
    assert "var(--m-ours)" in svg
    assert "var(--ink-2)" in svg
    assert "#0102" not in svg
    assert "#0103" not in svg
    assert svg == figures.over_time(
        "x", [0.0, 1.0], {"ours": [1.0, 2.0]}, styles_for(["ours"]), "mm", depth=[0.0, 1.0]
    )


def test_a_report_without_training_says_what_to_run(summary):
    bare = {**summary, "truth": None, "timings": {}, "phases": [], "held_out_states": {}, "ablation": None}
    bare |= {"benchmarks": [], "scenes": [], "headline": {"model": None, "cards": [], "hero_caption": ""}}
    text = render_page(PageContent(bare, {}, {}, styles_for(MODELS)))
    for verb in ("generate", "train", "simulate"):
        assert f"softprint {verb}" in text


def test_the_worst_shapes_can_be_extracted(summary, tmp_path):
    """As small pictures, by `softprint gather`."""
    row = dict.fromkeys(
        ("squared", "rms", "whole_squared", "whole_rms", "median", "worst", "samples", "sample"), 0.5
    )
    shapes = {"judged": "ours", "sides": {"ours": {"testing": row}}, "contacts": {"testing": 3}}
    counts = dict.fromkeys(("samples", "failed", "left_out", "after_jump", "pierced", "inverted"), 7)
    shapes |= {"answered": shapes["sides"], "left_out": {"testing": counts}}
    by_depth = {"bands": [{"from": 0.0, "to": 0.005, **row}], "deep_in_thin": [row]}
    shapes["depths"] = {"ours": by_depth}
    shapes["heaviest"] = {"at": [0.0, 0.01], "share": 0.73, "places": 6, "elsewhere": {"ours": row}}
    shapes["worst"] = [{"shape": "wood_screw", **row}]
    pictures = {
        name: encode(np.full((60, 400, 4), 200, dtype=np.uint8), name)
        for name in ("it", "full", "bare", "ours")
    }
    view = ShapeView(pictures["it"], [(name, pictures[name]) for name in ("full", "bare", "ours")])
    content = PageContent(
        {**summary, "scenes": [], "shapes": shapes},
        {},
        dict.fromkeys(("phases", "quality", "shapes"), ""),
        styles_for(MODELS),
        [("ours", pictures["it"])],
        [view],
    )
    page = tmp_path / "report.html"
    page.write_text(render_page(content), encoding="utf-8")
    (taken,) = worst_pictures(page)
    assert [(picture.alt, picture.width, picture.height) for picture in taken] == [
        (name, 340, 51) for name in ("it", "full", "ours")
    ]
    assert worst_pictures(tmp_path / "absent.html") == []
    assert "73.0\u202f%" in page.read_text(encoding="utf-8")


def test_the_conditions_of_a_benchmark_are_shown(summary):
    styles = styles_for(MODELS)
    summary = {**summary, "scenes": []}
    plots = dict.fromkeys(("phases", "quality"), "")
    assert "have not been timed here" in render_page(PageContent(summary, {}, plots, styles))
    speeds = {"columns": ["model", "p95"], "rows": [{"model": "ours", "p95": 0.025}]}
    told = {"scene": "press", "tolerance": 1e-6, "iterations": 40, "cores_used": 2}
    bench = {"name": "bench", **speeds, "conditions": told}
    text = render_page(PageContent({**summary, "benchmarks": [bench]}, {}, plots, styles))
    assert "have not been timed here" not in text
    assert "scene \u201cpress\u201d" in text
    assert "drawn in parallel with the next step" in text
    assert ">25.0\u202fms</data>" in text


@pytest.mark.parametrize(
    ("value", "style", "text"),
    [
        (0.41234, "percent", "41.2\u202f%"),
        (1.0, "percent", "100\u202f%"),
        (0.0, "percent", "0\u202f%"),
        (0.00123, "mm", "1.23\u202fmm"),
        (0.0071234, "ms", "7.12\u202fms"),
        (9649, "int", "9\u202f649"),
        (12.44, "times", "12.4\u202f\u00d7"),
        (3.2e-7, "plain", "3.2\u202f\u00d7\u202f10\u207b\u2077"),
        (143.2, "plain", "143"),
    ],
)
def test_numbers_have_three_digits_and_a_unit(value, style, text):
    assert format_number(value, style) == text


def test_json_has_no_nan():
    assert plain({"a": np.float64("nan"), "b": [np.inf, np.int64(3)], "c": np.array([1.5])}) == {
        "a": None,
        "b": [None, 3],
        "c": [1.5],
    }
    with pytest.raises(TypeError, match="set"):
        plain({"a": {1, 2}})


def test_the_headline_is_printable(summary):
    cards = headline_cards(summary, "ours", styles_for(MODELS))
    assert [card.label for card in cards][:2] == [
        "of the bare subspace\u2019s error remains",
        "error of the contact displacement itself",
    ]
    assert "Label-noise floor: 1.20" in cards[1].note
    assert "99.5\u202f% of the steps converged" in cards[2].note
    lines = console_lines(summary, cards)
    assert lines[0].startswith("toy")
    assert all("\u202f" not in line for line in lines)
    assert headline_cards(summary, None, {}) == []
