"""Errors by shape: the formula, the sides of the split, and reuse of measurements of an earlier run."""

from __future__ import annotations

import json
from types import SimpleNamespace

import numpy as np
import pytest

from softprint.fem_truth.report.measurements.shape_errors import (
    SampleErrors,
    depth_rows,
    heaviest_place,
    left_out,
    measure_samples,
    remembered,
    sides_of,
    worst_sample,
)
from softprint.fem_truth.report.shapes import known
from softprint.runtime.learned.static_correction import StaticCorrection
from softprint.runtime.truth.truth_file import load_truth
from softprint.runtime.truth.truth_schema import CONVERGED, UNREACHED
from tests.toy_truth import write_truth


class Share:
    """A field correction that returns a share of the exact displacement, bound to the nodes of the body."""

    name, collider, support = "share", "ball", np.inf

    def __init__(self, truth, share: float) -> None:
        self.truth, self.share = truth, share

    def bind(self, points, reach=np.inf):
        return self

    def displacement(self, rows, pose):
        at = [self.truth.pose(sample).translation for sample in range(len(self.truth.samples))]
        return self.share * self.truth.displacement(int(np.argmin(np.abs(at - pose.translation).sum(axis=1))))


@pytest.fixture
def truth(tmp_path, jelly2d_body):
    write_truth(tmp_path / "truth.h5", jelly2d_body)
    with load_truth(tmp_path / "truth.h5", jelly2d_body) as data:
        yield data


def test_a_sample_without_an_approach_is_its_whole_path(truth):
    """As in published truth, which has no approach paths."""
    assert [pose.translation.tolist() for pose in truth.approach_path(1)] == [
        truth.pose(1).translation.tolist()
    ]


@pytest.mark.parametrize("share", [0.0, 0.75, 1.0])
def test_a_model_that_returns_a_share_has_the_rest_as_error(truth, jelly2d_body, share):
    counted = []
    correction = StaticCorrection(Share(truth, share), jelly2d_body)
    errors = measure_samples(truth, jelly2d_body, {"ball": correction}.__getitem__, counted.append)
    assert errors.sample.tolist() == np.flatnonzero(truth.answered).tolist()
    assert sum(counted) == len(errors.sample)
    # Displacements are stored as float32: 6e-8 relative.
    assert errors.row()["rms"] == pytest.approx(1.0 - share, abs=1e-6)
    assert errors.row()["squared"] == pytest.approx((1.0 - share) ** 2, abs=1e-6)
    # The correction comes without static condensation, so all of that is missed too.
    assert errors.row()["whole_squared"] > errors.row()["squared"] - 1e-6
    volumes, sample = jelly2d_body.mesh.node_volumes, int(errors.sample[2])
    exact = (volumes[:, None] * truth.displacement(sample).astype(float) ** 2).sum()
    assert errors.contact[2] == pytest.approx(exact, rel=1e-6)


def test_every_sample_is_usable_left_out_or_failed(truth):
    """A contact of four depths that jumps at the third, and two others: pierced with inverted cells, and failed."""
    columns = truth.samples
    columns["contact"][:] = [0, 0, 0, 0, 1, 2]
    columns["depth_index"][:] = [0, 1, 2, 3, 0, 0]
    columns["branch_flag"][:] = [False, False, True, False, False, False]
    columns["status"][:] = [CONVERGED] * 5 + [UNREACHED]
    columns["intrusion"][:] = [0.0, 0.0, 0.0, 0.0, 1.0, np.nan]
    columns["min_det_F"][:] = [0.5, 0.5, 0.5, 0.5, -0.1, np.nan]
    assert left_out(truth, np.arange(6)) == {
        "samples": 6,
        "failed": 1,
        "left_out": 3,
        "after_jump": 2,
        "pierced": 1,
        "inverted": 1,
    }
    assert truth.usable.tolist() == [True, True, False, False, False, False]
    assert left_out(truth, np.array([0, 5]))["failed"] == 1


def errors_of(missed) -> SampleErrors:
    missed = np.asarray(missed, dtype=float)
    return SampleErrors(np.arange(len(missed)), np.ones(len(missed)), missed, np.ones(len(missed)), missed)


def test_samples_are_counted_by_depth(truth):
    """Bands of 1 mm, of which the second has no sample; the deepest are in the last, and nearly as deep as the
    collider is thick."""
    depth = truth.samples["depth"]
    depth[:4], depth[4:] = [0.0005, 0.0009, 0.0025, 0.003], 0.003
    truth.contacts["thickness"][:] = 0.0038  # three quarters are 2.85 mm
    missed = np.zeros(len(depth))
    missed[:2], missed[2], missed[3:] = 0.1, 0.4, 0.6
    found = depth_rows(truth, errors_of(missed))
    shallow, deep = found["bands"]
    assert (shallow["from"], deep["from"], deep["to"]) == pytest.approx((0.0, 0.002, 0.003))
    assert (shallow["samples"], deep["samples"]) == (2, len(missed) - 2)
    assert shallow["squared"] == pytest.approx(0.1)
    (thin,) = found["deep_in_thin"]
    assert (thin["samples"], thin["squared"]) == pytest.approx((len(missed) - 3, 0.6))


def test_the_place_with_most_of_the_displacement_is_named(truth):
    """Two places, and at one of them nine tenths of the squared displacement, of which a model misses a half."""
    place, contact = truth.contacts["place"], truth.samples["contact"]
    contact[:] = np.arange(len(contact)) % 2
    place[0], place[1] = 3, 8
    heavy = contact[:] == 1
    displacement = np.where(heavy, 9.0 / heavy.sum(), 1.0 / (~heavy).sum())
    missed = displacement * np.where(heavy, 0.5, 0.1)
    errors = SampleErrors(np.arange(len(missed)), displacement, missed, displacement, missed)
    points = np.arange(20.0).reshape(10, 2)
    found = heaviest_place(truth, {"ours": errors}, points)
    assert (found["at"], found["places"]) == ([16.0, 17.0], 2)
    assert found["share"] == pytest.approx(0.9)
    assert found["elsewhere"]["ours"]["squared"] == pytest.approx(0.1)
    place[0] = 8
    assert heaviest_place(truth, {"ours": errors}, points)["elsewhere"] == {}


def test_the_worst_sample_has_the_largest_error(truth):
    assert worst_sample(truth, errors_of([0.1, 0.4, 0.2]), "ball") == 1


def test_sides_are_disjoint_and_complete(truth):
    sample = np.arange(4)
    sides = sides_of(truth, sample, {"ball", "egg"}, {"egg"})
    assert sides.learned.all()
    assert not (sides.validation | sides.testing).any()
    assert sides_of(truth, sample, {"ball", "egg"}, {"ball"}).validation.all()
    assert sides_of(truth, sample, {"egg"}, {"egg"}).testing.all()


def test_measurements_are_reused_until_truth_or_correction_changes(tmp_path):
    path, made_of = tmp_path / "shapes" / "ours.json", {"truth": "a", "correction": "b"}
    path.parent.mkdir()
    first = remembered(path, made_of, lambda: errors_of([0.1, 0.2]))
    again = remembered(path, made_of, lambda: pytest.fail("measured a second time"))
    np.testing.assert_array_equal(again.missed_contact, first.missed_contact)
    assert again.row() == first.row()
    other = remembered(path, {**made_of, "truth": "c"}, lambda: errors_of([0.3]))
    assert len(other.sample) == 1
    for damage in ("{", json.dumps([1]), json.dumps({"made_of": {**made_of, "truth": "c"}})):
        path.write_text(damage)
        assert len(remembered(path, {**made_of, "truth": "c"}, lambda: errors_of([0.3])).sample) == 1


def test_an_experiment_that_plays_what_another_has_trained_need_not_know_its_shapes():
    """As that of the hat, in the run directory of the library."""
    truth = SimpleNamespace(header=SimpleNamespace(colliders=("ball", "torus")))
    assert known(truth, SimpleNamespace(collider_names=["hat", "torus", "ball"]))
    assert not known(truth, SimpleNamespace(collider_names=["hat", "torus"]))
