"""Errors of corrections relative to the truth of a library's samples: on training shapes and on unseen ones.

For samples S, with node volumes V_i, u* the exact contact displacement and u that of a model at the same state,

    squared error = sum_{s in S} sum_i V_i |u_i - u*_i|^2 / sum_{s in S} sum_i V_i |u*_i|^2,

the mean squared error relative to the mean squared displacement, as in table 6.1 of the thesis, and its root.
In the thesis, the displacement is everything that full space adds to the subspace; here both are measured: that, and
contact alone.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from softprint.runtime.arrays import Array, BoolArray, IntArray
from softprint.runtime.body.body import ReducedBody
from softprint.runtime.errors import SoftprintError
from softprint.runtime.forked_workers import ForkedWorkers
from softprint.runtime.io.kept_json import keep, read_kept
from softprint.runtime.learned.static_correction import StaticCorrection
from softprint.runtime.learned.worst_error import worst_relative_error
from softprint.runtime.truth.shared_samples import workers_for
from softprint.runtime.truth.truth_file import TruthData


@dataclass(frozen=True, eq=False)
class SampleErrors:
    """For samples (n,) of a truth file, sums over the nodes in m^5. contact: the squared exact contact
    displacement; missed_contact: the squared error of a model; whole, missed_whole: the same with the internal
    displacement. sample: rows of the truth file."""

    sample: IntArray
    contact: Array
    missed_contact: Array
    whole: Array
    missed_whole: Array

    def take(self, keep: BoolArray) -> SampleErrors:
        return SampleErrors(*(getattr(self, name)[keep] for name in self.__dataclass_fields__))

    def row(self) -> dict[str, float]:
        """A table row: the formula above, its root, and for contact alone the median and the worst sample, each
        relative to its own displacement; samples with hardly any displacement are left out of the worst."""
        squared = float(self.missed_contact.sum() / self.contact.sum())
        whole = float(self.missed_whole.sum() / self.whole.sum())
        relative = np.sqrt(self.missed_contact / self.contact)
        return {
            "squared": squared,
            "rms": squared**0.5,
            "whole_squared": whole,
            "whole_rms": whole**0.5,
            "median": float(np.median(relative)),
            "worst": worst_relative_error(self.missed_contact, self.contact),
            "samples": len(self.sample),
        }


def measure_samples(
    truth: TruthData,
    body: ReducedBody,
    corrected: Callable[[str], StaticCorrection],
    progress: Callable[[int], None],
) -> SampleErrors:
    """Errors of one model at all samples to which full space has an answer, usable or not. corrected: returns the model
    bound to the collider of that name."""
    samples = np.flatnonzero(truth.answered)
    _, collider = np.unique(_colliders(truth, samples), return_inverse=True)

    def work(share: IntArray, progress: Callable[[int], None]) -> Array:
        return _sums(truth, body, corrected, samples[share], progress)

    # Collider by collider: a worker binds the model to those that it is given.
    count = min(workers_for(truth, samples), int(collider.max(initial=0)) + 1)
    shares = [np.flatnonzero(collider % count == worker) for worker in range(count)]
    columns = np.zeros((4, len(samples)))
    with ForkedWorkers(work, count) as workers:
        for share, sums in zip(shares, workers.map(shares, progress), strict=True):
            columns[:, share] = sums
    return SampleErrors(samples, *columns)


def _colliders(truth: TruthData, samples: IntArray) -> IntArray:
    """(n,) numbers of the colliders of samples (n,)."""
    return np.asarray(truth.contacts["collider"][truth.samples["contact"][samples]])


def _sums(
    truth: TruthData,
    body: ReducedBody,
    corrected: Callable[[str], StaticCorrection],
    samples: IntArray,
    progress: Callable[[int], None],
) -> Array:
    """The columns (4, n) of `SampleErrors` of samples (n,)."""
    volumes, number = body.mesh.node_volumes[:, None], _colliders(truth, samples)
    internal, columns = truth.states["internal"], np.zeros((4, len(samples)))
    for collider in np.unique(number):
        model = corrected(truth.header.colliders[collider])
        for place in np.flatnonzero(number == collider):
            sample, state = samples[place], truth.sample_state[samples[place]]
            rows = truth.states["rows"][state]
            exact = truth.displacement(int(sample)).astype(np.float64)
            error = model.displacement_along(rows, truth.approach_path(int(sample))) - exact
            missed_internal = model.condensed_displacement(rows) - internal[state]
            fields = (exact, error, exact + internal[state], error + missed_internal)
            columns[:, place] = [float((volumes * field**2).sum()) for field in fields]
            progress(1)
    return columns


def remembered(path: Path, made_of: Mapping[str, str], measure: Callable[[], SampleErrors]) -> SampleErrors:
    """The measurement of an earlier run with the same inputs, or a new one, which is saved."""
    kept = read_kept(path, made_of)
    try:
        if kept is not None:
            return SampleErrors(
                np.array(kept.pop("sample"), dtype=np.int64),
                **{name: np.array(column, dtype=float) for name, column in kept.items()},
            )
    except (ValueError, TypeError, KeyError):
        pass  # damaged: it is measured again
    errors = measure()
    keep(path, made_of, {name: getattr(errors, name).tolist() for name in SampleErrors.__dataclass_fields__})
    return errors


@dataclass(frozen=True, eq=False)
class Sides:
    """Masks (n,) of samples of training shapes, of validation shapes, and of testing shapes."""

    learned: BoolArray
    validation: BoolArray
    testing: BoolArray

    def named(self) -> Iterator[tuple[str, BoolArray]]:
        for name in self.__dataclass_fields__:
            yield name, getattr(self, name)


def sides_of(truth: TruthData, sample: IntArray, training: set[str], validation: set[str]) -> Sides:
    """The side of each sample, from the names of the training shapes (which include validation shapes)."""
    names = np.array(truth.header.colliders)[_colliders(truth, sample)]
    trained, chosen = np.isin(names, sorted(training)), np.isin(names, sorted(validation))
    return Sides(trained & ~chosen, chosen, ~trained)


def left_out(truth: TruthData, sample: IntArray) -> dict[str, int]:
    """How many of these samples no model learns from or is judged by, and why; a sample may count in several columns
    after the first two."""
    answered = truth.answered[sample]
    return {
        "samples": len(sample),
        "failed": int((~answered).sum()),
        "left_out": int((answered & ~truth.usable[sample]).sum()),
        "after_jump": int((answered & truth.after_jump[sample]).sum()),
        "pierced": int((answered & truth.pierced[sample]).sum()),
        "inverted": int((answered & truth.inverted[sample]).sum()),
    }


def shape_rows(truth: TruthData, errors: SampleErrors) -> dict[str, dict[str, float]]:
    """`SampleErrors.row` of every shape that has samples, by name."""
    number = _colliders(truth, errors.sample)
    return {truth.header.colliders[shape]: errors.take(number == shape).row() for shape in np.unique(number)}


def depth_bands(truth: TruthData, sample: IntArray, bands: int = 3) -> list[tuple[float, float, BoolArray]]:
    """Bands of depth of equal width down to the deepest usable sample: the lower and the upper end [m], and which of
    some samples (n,) are in it; those without samples are left out."""
    depth = truth.samples["depth"]
    ends = np.linspace(0.0, float(depth[truth.usable].max()), bands + 1)
    band = np.clip(np.searchsorted(ends, depth[sample]) - 1, 0, bands - 1)
    return [(float(ends[k]), float(ends[k + 1]), band == k) for k in range(bands) if (band == k).any()]


def depth_rows(truth: TruthData, errors: SampleErrors) -> dict[str, list[dict[str, float]]]:
    """`SampleErrors.row` of samples by their depth. bands: of `depth_bands`, with their lower and upper end [m];
    deep_in_thin: of samples deeper than three quarters of the collider's thickness, where there are any."""
    rows = [
        {"from": low, "to": high, **errors.take(band).row()}
        for low, high, band in depth_bands(truth, errors.sample)
    ]
    thin = truth.deep_in_thin[errors.sample]
    return {"bands": rows, "deep_in_thin": [errors.take(thin).row()] if thin.any() else []}


def heaviest_place(truth: TruthData, errors: Mapping[str, SampleErrors], points: Array) -> dict[str, Any]:
    """Of the places on the body where colliders are pressed, that with the most squared contact displacement: where it
    is at rest [m], its share of that displacement, the number of places, and the squared error of every model at the
    others, where there are any. errors: of models at the same samples; points: of the mesh (n_nodes, dim) [m]."""
    first = next(iter(errors.values()))
    place = truth.contacts["place"][truth.samples["contact"][first.sample]]
    places, number = np.unique(place, return_inverse=True)
    there = np.bincount(number, weights=first.contact)
    heaviest = int(np.argmax(there))
    others = number != heaviest
    return {
        "at": points[places[heaviest]].tolist(),
        "share": float(there[heaviest] / there.sum()),
        "places": len(places),
        "elsewhere": {name: found.take(others).row() for name, found in errors.items()}
        if others.any()
        else {},
    }


def worst_sample(truth: TruthData, errors: SampleErrors, shape: str) -> int:
    """Row of the truth file of the shape's sample with the largest absolute error."""
    number = _colliders(truth, errors.sample)
    of_shape = np.flatnonzero(number == truth.header.colliders.index(shape))
    if not of_shape.size:
        raise SoftprintError(f"{truth.path}: no usable sample of {shape!r}")
    return int(errors.sample[of_shape[np.argmax(errors.missed_contact[of_shape])]])
