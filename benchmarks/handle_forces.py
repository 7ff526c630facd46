"""Generalised contact forces of all models against the samples of a truth.

    python -m benchmarks.handle_forces examples/jelly_library_small.toml [--out RUN] [--most N] [--models bare ours ...]

The generalised contact force h of a sample is the derivative by the handle rows of the energy that contact adds, in
newtons along the coordinates of the handles that are not held in every scene; its sum over the handles is the force on
the collider. Printed is, of both, for every model and for training, validation and unseen shapes apart,

    sqrt(sum |h - h_truth|^2 / sum |h_truth|^2),

its square, the median over samples of |h - h_truth| / |h_truth|, and its 95th percentile. Where a collider presses a
rigid frame, the force on it is as large as the penalty has it, and a few such samples outweigh all others: it is
printed with these samples and without. Shapes never seen are printed by depth as well, in three bands. Without a
library there are none: models of form force learn from all states. N:
samples of each side at most, drawn at random; by default all. Samples that are not usable are left out, see
`softprint inspect TRUTH.h5`.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from softprint.fem_truth.report.measurements.shape_errors import depth_bands
from softprint.runtime.arrays import Array, BoolArray, IntArray
from softprint.runtime.body import ReducedBody, load_body
from softprint.runtime.cli.context import Context
from softprint.runtime.cli.script import run_script
from softprint.runtime.colliders.build import build_collider
from softprint.runtime.colliders.collider import Collider
from softprint.runtime.contact import PenaltyContact
from softprint.runtime.contact.frame_points import FramePoints
from softprint.runtime.dynamics.handle_forces import HandleCoordinates, StaticContact
from softprint.runtime.dynamics.placed_collider import PlacedCollider
from softprint.runtime.experiment import Experiment
from softprint.runtime.learned.correction import ContactCorrection
from softprint.runtime.learned.correction_file import TrainedCorrection, read_correction
from softprint.runtime.scenes.scene import held_frames
from softprint.runtime.truth.truth_file import TruthData, load_truth

BARE = "bare"


def sides(truth: TruthData, experiment: Experiment) -> dict[str, BoolArray]:
    """Masks (n_samples,) of the usable samples: by shape with a library; with one collider all, from which
    models of form force learn."""
    names = np.array(truth.header.colliders)[truth.contacts["collider"][truth.samples["contact"]]]
    roles = experiment.library_roles
    if experiment.training.collider == "library":
        of = {"training": "train", "validation": "validation", "unseen shapes": "test"}
        return {
            side: truth.usable & np.array([roles.get(name, "test") == role for name in names])
            for side, role in of.items()
        }
    return {"all": truth.usable}


class Model:
    """A model of contact. correction: None for the bare subspace."""

    def __init__(
        self, body: ReducedBody, experiment: Experiment, correction: TrainedCorrection | None
    ) -> None:
        self._body, self._correction = body, correction
        self._law = PenaltyContact.of(experiment.contact)

    def on(self, collider: Collider) -> StaticContact:
        """Its contact with one collider."""
        correction = None if self._correction is None else self._correction.on(collider)
        mechanics = correction.mechanics if isinstance(correction, ContactCorrection) else None
        placed = PlacedCollider(collider.name, collider, correction=correction)
        return StaticContact(self._body, [placed], self._law, mechanics)


def handle_forces(
    truth: TruthData, experiment: Experiment, model: Model, samples: IntArray, progress: Context
) -> Array:
    """h (n, n_rows, dim) [N] at samples (n,)."""
    number = truth.contacts["collider"][truth.samples["contact"][samples]]
    found = np.empty((len(samples), *truth.states["rows"].shape[1:]))
    with progress.progress(len(samples), "sample", "solving contacts") as bar:
        for one in np.unique(number):
            name = truth.header.colliders[one]
            contact = model.on(build_collider(experiment.collider(name), experiment.base_dir))
            for place in np.flatnonzero(number == one):
                sample = int(samples[place])
                rows = truth.states["rows"][truth.sample_state[sample]]
                way = [{name: pose} for pose in truth.approach_path(sample)]
                found[place] = contact.handle_force(rows, way)
                bar.update(1)
    return found


def on_frames(truth: TruthData, body: ReducedBody, experiment: Experiment, samples: IntArray) -> BoolArray:
    """In which samples (n,) the collider presses a rigid frame."""
    number = truth.contacts["collider"][truth.samples["contact"][samples]]
    found = np.zeros(len(samples), dtype=bool)
    if not body.handles.frames:
        return found
    points = FramePoints.of(body, body.mesh.surface_spacing)
    for one in np.unique(number):
        name = truth.header.colliders[one]
        collider = build_collider(experiment.collider(name), experiment.base_dir)
        for place in np.flatnonzero(number == one):
            sample = int(samples[place])
            rows = truth.states["rows"][truth.sample_state[sample]]
            found[place] = points.any_inside(rows, collider, truth.approach_path(sample)[-1])
    return found


def by_depth(truth: TruthData, samples: IntArray) -> dict[str, BoolArray]:
    """Masks (n,) of samples by depth, and of those deeper than three quarters of the collider's thickness, with what
    they are called; bands without samples are left out."""
    bands = {
        f"{1e3 * low:.1f} to {1e3 * high:.1f} mm": band for low, high, band in depth_bands(truth, samples)
    }
    thin = truth.deep_in_thin[samples]
    return {**bands, "over 3/4 of the thickness": thin} if thin.any() else bands


def line(model: str, side: str, what: str, found: Array, true: Array) -> str:
    """A line of the table, of forces (n, k) [N]."""
    miss, size = (np.linalg.norm(of, axis=1) for of in (found - true, true))
    rms, each = np.linalg.norm(miss) / np.linalg.norm(size), miss / size
    return (
        f"| {model} | {side} | {what} | {rms:.1%} | {rms**2:.2%} | {np.median(each):.1%} | "
        f"{np.quantile(each, 0.95):.1%} | {len(each)} |"
    )


def main(arguments: Sequence[str] | None = None) -> None:
    """Prints a table in Markdown."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("experiment", type=Path, metavar="EXPERIMENT.toml")
    parser.add_argument("--out", type=Path, default=None, metavar="RUN", help="run directory")
    parser.add_argument("--most", type=int, default=None, metavar="N", help="samples of each side at most")
    parser.add_argument("--models", nargs="+", default=[BARE, "mechanics", "ours"], metavar="NAME")
    options = parser.parse_args(arguments)
    context = Context(options.experiment, out=options.out)
    experiment, run = context.experiment, context.out_dir
    body = load_body(run / "body.h5")
    handles = HandleCoordinates(body, held_frames(experiment))
    models = {}
    for name in options.models:
        trained = None if name == BARE else read_correction(run / f"corrections/{name}.safetensors", body)
        models[name] = Model(body, experiment, trained)
    print("| model | samples of | force on | RMS | squared | median | 95 % | samples |")
    print("| --- " * 8 + "|")
    with load_truth(run / "truth.h5", body) as truth:
        drawn = {
            side: np.random.default_rng(0).permutation(np.flatnonzero(mask))[: options.most]
            for side, mask in sides(truth, experiment).items()
        }
        free = {side: ~on_frames(truth, body, experiment, samples) for side, samples in drawn.items()}
        for name, model in models.items():
            for side, samples in drawn.items():
                found = handle_forces(truth, experiment, model, samples, context)
                true = np.array([truth.contact_handle_force(int(sample)) for sample in samples])
                rows = truth.states["rows"][truth.sample_state[samples]]
                along = [
                    np.array([handles.along(*one) for one in zip(rows, of, strict=True)])
                    for of in (found, true)
                ]
                print(line(name, side, "handles", *along))
                summed = [np.einsum("r,nra->na", body.handles.affine_part, of) for of in (found, true)]
                print(line(name, side, "collider", *summed), flush=True)
                if not free[side].all():
                    print(line(name, side, "collider, off frames", *(of[free[side]] for of in summed)))
                if side.startswith("unseen"):
                    for depths, of_band in by_depth(truth, samples).items():
                        print(line(name, depths, "handles", *(of[of_band] for of in along)))
                        off_frames = of_band & free[side]
                        if off_frames.any():
                            print(
                                line(name, depths, "collider, off frames", *(of[off_frames] for of in summed))
                            )


if __name__ == "__main__":
    run_script(main)
