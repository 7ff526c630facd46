"""The mechanics file of a body, computed once for all corrections of a run directory."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from softprint.runtime.cli.context import Context
from softprint.runtime.cli.run_body import body_of_run
from softprint.runtime.cli.run_mechanics import RunMechanics
from softprint.runtime.contact import PenaltyContact
from softprint.runtime.dynamics import Simulator
from softprint.runtime.errors import SoftprintError
from softprint.runtime.mechanics.body_mechanics import compute_mechanics
from softprint.runtime.mechanics.mechanics_file import (
    as_saved,
    load_mechanics,
    mechanics_hash,
    mechanics_path,
    read_mechanics,
    save_mechanics,
)
from tests.bad_input.altered import alter_tensors, flipped
from tests.toy_experiment import write_experiment

GRAVITY = [0.0, -9.81]


@pytest.fixture(scope="module")
def mechanics(jelly2d_body):
    return compute_mechanics(jelly2d_body, 200, condensation=True, gravity=GRAVITY)


@pytest.fixture
def path(tmp_path, jelly2d_body, mechanics) -> Path:
    path = mechanics_path(tmp_path, 200)
    save_mechanics(path, mechanics, jelly2d_body, 200)
    return path


def test_round_trip(path, jelly2d_body, mechanics):
    header, loaded = read_mechanics(str(path), jelly2d_body)
    fresh = as_saved(mechanics)
    np.testing.assert_array_equal(loaded.compliance.dense(), fresh.compliance.dense())
    # Half precision of the largest entry.
    largest = np.abs(mechanics.compliance.dense()).max()
    np.testing.assert_allclose(fresh.compliance.dense(), mechanics.compliance.dense(), atol=1e-3 * largest)
    rows = jelly2d_body.rest_rows
    np.testing.assert_array_equal(
        loaded.condensation.corotated(rows).displacement(rows),
        mechanics.condensation.corotated(rows).displacement(rows),
    )
    assert (header.body_hash, header.contact_nodes) == (jelly2d_body.content_hash, 200)
    assert (header.gravity, header.static_condensation) == (GRAVITY, True)
    assert header.provenance


def test_the_hash_is_that_of_what_is_in_the_file(path, jelly2d_body, mechanics):
    header, loaded = read_mechanics(path, jelly2d_body)
    assert mechanics_hash(mechanics) == mechanics_hash(loaded) == header.content_hash
    again = compute_mechanics(jelly2d_body, 200, condensation=True, gravity=GRAVITY)
    assert mechanics_hash(again) == header.content_hash
    assert mechanics_hash(loaded._replace(condensation=None)) != header.content_hash


def test_without_static_condensation(tmp_path, jelly2d_body, mechanics):
    header = save_mechanics(tmp_path / "x.safetensors", mechanics._replace(condensation=None), jelly2d_body)
    assert (header.gravity, header.static_condensation) == ([], False)
    assert header.contact_nodes == len(mechanics.compliance.nodes)
    assert load_mechanics(tmp_path / "x.safetensors", jelly2d_body).condensation is None


def test_another_body_is_refused(path, jelly3d_body):
    with pytest.raises(SoftprintError, match=r"of another body .*: make it again with `softprint mechanics`"):
        load_mechanics(path, jelly3d_body)


def test_mechanics_of_another_body_are_refused_before_they_are_in_a_file(tmp_path, jelly2d_body, mechanics):
    """As those of a stiffness that was tried before: by a simulator, and by what would write a file of them."""
    material = replace(jelly2d_body.material, young=10.0 * jelly2d_body.material.young)
    stiffer = replace(jelly2d_body, material=material)
    with pytest.raises(SoftprintError, match="mechanics of another body"):
        save_mechanics(tmp_path / "m.safetensors", mechanics, stiffer)
    assert not list(tmp_path.glob("m*"))
    for refused in (mechanics, as_saved(mechanics)):
        with pytest.raises(SoftprintError, match="mechanics of another body"):
            Simulator(stiffer, contact=PenaltyContact(1e9), mechanics=refused)


def test_bad_files_are_refused(path, jelly2d_body, tmp_path):
    other, whole = tmp_path / "other.safetensors", path.read_bytes()
    for content in (whole[:-100], whole[:50], b"", flipped(whole, len(whole) // 2), flipped(whole, 200)):
        other.write_bytes(content)
        with pytest.raises(SoftprintError, match=r"other\.safetensors: .*make it again with"):
            load_mechanics(other, jelly2d_body)
    with pytest.raises(SoftprintError, match="no such mechanics file"):
        load_mechanics(tmp_path / "absent.safetensors", jelly2d_body)
    for change, complaint in (
        ({"softprint_version": "99"}, "version 99"),
        ({"softprint_kind": "correction"}, "no mechanics"),
        ({"header": json.dumps({"body_hash": "x"})}, "header is incomplete"),
    ):
        shutil.copy(path, other)
        alter_tensors(other, change)
        with pytest.raises(SoftprintError, match=complaint):
            load_mechanics(other, jelly2d_body)
    shutil.copy(path, other)
    alter_tensors(other, {}, dropped=1)
    with pytest.raises(SoftprintError, match="the mechanics are incomplete"):
        load_mechanics(other, jelly2d_body)


@pytest.fixture
def run(tmp_path):
    """Makes a context of a toy experiment, and the list of its output lines."""
    experiment, said = write_experiment(tmp_path, 2), []

    def context(*overrides: str, resume: bool = True) -> Context:
        return Context(
            experiment, overrides, tmp_path / "run", quiet=True, resume=resume, rank=0, write=said.append
        )

    return context, said


def test_a_run_computes_them_once(run, monkeypatch):
    context, said = run
    body = body_of_run(context())
    header, made = RunMechanics(context(), body).get(20)
    assert header.contact_nodes == 20
    assert "mechanics_20.safetensors written" in said[-1]
    said.clear()
    kept_header, kept = RunMechanics(context(), body).get(20)
    assert not said
    assert kept_header == header
    np.testing.assert_array_equal(kept.compliance.dense(), made.compliance.dense())
    RunMechanics(context(), body).get(10)
    assert "mechanics_10.safetensors written" in said[-1]


def test_a_run_computes_them_again_if_they_do_not_fit(run, jelly2d_body, mechanics, caplog):
    context, said = run
    body = body_of_run(context())
    header, _ = RunMechanics(context(), body).get(20)
    path = RunMechanics(context(), body).path(20)
    whole = path.read_bytes()
    turned, _ = RunMechanics(context("dynamics.gravity=[-9.81, 0.0]"), body).get(20)
    assert turned.gravity == [-9.81, 0.0]
    assert turned.content_hash != header.content_hash
    for content in (whole[:-100], flipped(whole, len(whole) // 2)):
        path.write_bytes(content)
        caplog.clear()
        assert RunMechanics(context(), body).get(20)[0].content_hash == header.content_hash
        assert "mechanics file is damaged" in caplog.text
    save_mechanics(path, mechanics, jelly2d_body, 20)
    assert RunMechanics(context(), body).get(20)[0].body_hash == body.content_hash
    assert "of another body" in caplog.text
    said.clear()
    RunMechanics(context(resume=False), body).get(20)
    assert "written" in said[-1]
