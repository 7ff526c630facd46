"""The error formulas on cases computed by hand, and their invariances."""

import numpy as np
import pytest

from softprint.fem_truth.report.measurements.comparison import (
    ModelFrames,
    error_row,
    error_table,
    evenly_spaced,
    frames_to_show,
    measure_frame,
    pool,
    relative_displacement_error,
)

ROUND_OFF = 1e-12  # sums of a few squares in float64


def one_frame(positions, bare, full, frame=0, near=None, depth=(0.0,), inverted=0):
    near = np.ones(len(full), dtype=bool) if near is None else near
    return measure_frame(frame, positions, bare, full, near, np.asarray(depth, dtype=float), inverted)


@pytest.fixture
def positions():
    rng = np.random.default_rng(3)
    return rng.normal(size=(3, 40, 3))  # model, bare, full


def test_bare_has_exactly_one_and_a_perfect_model_exactly_zero(positions):
    _, bare, full = positions
    row = error_row(one_frame(bare, bare, full))
    assert row.relative_rms == row.relative_rms_squared == row.relative_median == row.relative_worst == 1.0
    perfect = error_row(one_frame(full, bare, full))
    assert perfect.relative_rms == perfect.rms == perfect.worst_node == 0.0


def test_by_hand():
    """Two nodes: bare is off by 3 and 4, the model by 0 and 2.5: sqrt(6.25 / 25) = 1/2, RMS sqrt(6.25 /
    2)."""
    full = np.zeros((2, 2))
    bare = np.array([[3.0, 0.0], [0.0, 4.0]])
    model = np.array([[0.0, 0.0], [1.5, 2.0]])
    row = error_row(one_frame(model, bare, full, depth=[0.1, 0.3]))
    assert row.relative_rms == pytest.approx(0.5, abs=ROUND_OFF)
    assert row.relative_rms_squared == pytest.approx(0.25, abs=ROUND_OFF)
    assert row.rms == pytest.approx(np.sqrt(6.25 / 2), abs=ROUND_OFF)
    assert row.worst_node == pytest.approx(2.5, abs=ROUND_OFF)
    assert row.max_penetration == 0.3


def test_frames_that_no_one_should_see_are_counted():
    """With an inverted cell, and with a node farther off than any of the bare subspace."""
    full, bare = np.zeros((2, 2)), np.array([[3.0, 0.0], [0.0, 4.0]])
    model = np.array([[0.0, 0.0], [1.5, 2.0]])
    frames = [
        one_frame(model, bare, full),
        one_frame(model, bare, full, inverted=2),
        one_frame(1.1 * bare, bare, full),
    ]
    row = error_row(pool(frames))
    assert (row.inverted_frames, row.worse_frames, row.n_frames) == (1, 1, 3)


def test_near_contact_counts_only_the_marked_nodes():
    full = np.zeros((2, 2))
    bare = np.array([[2.0, 0.0], [5.0, 0.0]])
    model = np.array([[1.0, 0.0], [5.0, 0.0]])
    row = error_row(one_frame(model, bare, full, near=np.array([True, False])))
    assert row.relative_near_contact == pytest.approx(0.5, abs=ROUND_OFF)


def test_frames_are_pooled_by_their_squares_and_not_by_their_ratios():
    """Frame 0 weighs 1, frame 1 weighs 100: the ratio of sums is sqrt((1 + 25) / 101), not the mean of 1 and
    1/2."""
    full = np.zeros((1, 2))
    small = one_frame(np.array([[1.0, 0.0]]), np.array([[1.0, 0.0]]), full, frame=4)
    large = one_frame(np.array([[5.0, 0.0]]), np.array([[10.0, 0.0]]), full, frame=9)
    row = error_row(pool([small, large]))
    assert row.relative_rms == pytest.approx(np.sqrt(26 / 101), abs=ROUND_OFF)
    assert row.relative_median == pytest.approx(0.75, abs=ROUND_OFF)
    assert (row.worst_frame, row.relative_worst, row.n_frames) == (4, 1.0, 2)


@pytest.mark.parametrize("dim", [2, 3])
def test_rigid_motion_and_scale_change_nothing_relative(dim):
    rng = np.random.default_rng(dim)
    model, bare, full = rng.normal(size=(3, 30, dim))
    rotation = np.linalg.qr(rng.normal(size=(dim, dim)))[0]
    shift = rng.normal(size=dim)
    before = error_row(one_frame(model, bare, full))
    moved = [x @ rotation.T + shift for x in (model, bare, full)]
    after = error_row(one_frame(*moved))
    assert after.relative_rms == pytest.approx(before.relative_rms, rel=ROUND_OFF)
    assert after.rms == pytest.approx(before.rms, rel=ROUND_OFF)
    larger = error_row(one_frame(*(1e3 * x for x in (model, bare, full))))
    assert larger.relative_rms == pytest.approx(before.relative_rms, rel=ROUND_OFF)
    assert larger.rms == pytest.approx(1e3 * before.rms, rel=ROUND_OFF)


def test_without_anything_to_correct_only_zero_has_a_finite_error():
    still = np.zeros((3, 2))
    assert error_row(one_frame(still, still, still)).relative_rms == 0.0
    assert error_row(one_frame(still + 1.0, still, still)).relative_rms == np.inf


def test_an_empty_table_is_refused(positions):
    frames = one_frame(*positions)
    with pytest.raises(ValueError, match="at least one frame"):
        error_row(frames.take(np.array([False])))


def test_error_table_keeps_the_order(positions):
    frames = one_frame(*positions)
    assert list(error_table({"b": frames, "a": frames})) == ["b", "a"]


def test_relative_displacement_error():
    exact, missed = np.array([9.0, 16.0]), np.array([0.0, 6.25])
    assert relative_displacement_error(missed, exact) == pytest.approx(0.5, abs=ROUND_OFF)


def test_evenly_spaced_keeps_both_ends():
    frames = np.arange(10, 60)
    chosen = evenly_spaced(frames, 6)
    assert (len(chosen), chosen[0], chosen[-1]) == (6, 10, 59)
    assert np.ptp(np.diff(chosen)) <= 1
    assert np.array_equal(evenly_spaced(frames[:3], 6), frames[:3])


def frames_with_rms(frames, rms):
    n = len(frames)
    zeros = np.zeros(n)
    return ModelFrames(*[zeros] * 4, np.asarray(rms, dtype=float), *[zeros] * 4, np.asarray(frames))


def test_frames_to_show_follow_the_rule_and_do_not_repeat():
    contact = np.arange(100, 109)
    depth = np.array([1, 2, 3, 9, 5, 4, 3, 2, 1.0])
    shown = frames_to_show(contact, depth, frames_with_rms(contact, [0, 0, 0, 0, 0, 0, 0, 7, 0]))
    assert dict(shown) == {
        102: "first quartile",
        103: "deepest contact",
        104: "middle of the contact",
        106: "third quartile",
        107: "worst frame",
    }
    alone = frames_to_show(contact[:1], depth[:1], frames_with_rms([100], [1.0]))
    assert [frame for frame, _ in alone] == [100]
