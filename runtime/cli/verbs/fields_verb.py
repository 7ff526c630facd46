"""`softprint fields`: displacement, strain, stress and contact pressure of samples and frames, for ParaView."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from softprint.runtime.cli.context import Context
from softprint.runtime.cli.verb import Verb

if TYPE_CHECKING:
    from collections.abc import Iterable

    from softprint.runtime.body import ReducedBody
    from softprint.runtime.colliders import Collider
    from softprint.runtime.fields.deformed import Deformed
    from softprint.runtime.truth.truth_file import TruthData

FOLDER = "fields"


def configure(parser: argparse.ArgumentParser) -> None:
    """Samples, or frames of a motion."""
    parser.add_argument(
        "--sample",
        type=int,
        action="append",
        metavar="K",
        help="a sample of truth.h5; repeatable (default: the deepest converged one)",
    )
    parser.add_argument("--contact", type=int, metavar="C", help="all depths of one contact of truth.h5")
    parser.add_argument(
        "--motion", metavar="NAME", help="a motion instead of the truth, such as held_out_ours"
    )
    parser.add_argument(
        "--frame",
        type=int,
        action="append",
        metavar="K",
        help="a frame of the motion; repeatable (default: all)",
    )


def run(args: argparse.Namespace, context: Context) -> int:
    """Write one .vtu for each sample or frame and its colliders, and a .pvd that opens them together.

    Pressure follows the penalty law at the drawn positions. For truth, full space and the bare subspace it is the
    pressure that acted on the body. Corrections of form force have contact forces of their own: they are in the motion
    file, and `softprint touch` distributes them over the surface.
    """
    from softprint.runtime.cli.run_body import body_of_run
    from softprint.runtime.errors import SoftprintError
    from softprint.runtime.fields.sources import deformed_frames, deformed_samples
    from softprint.runtime.scenes.motion_colliders import build_colliders
    from softprint.runtime.scenes.motion_file import load_motion
    from softprint.runtime.truth.truth_colliders import require_same_colliders
    from softprint.runtime.truth.truth_file import load_truth

    if args.motion is None and args.frame is not None:
        raise SoftprintError("--frame needs a motion: name it with --motion, such as --motion held_out_ours")
    if args.motion is not None and (args.sample is not None or args.contact is not None):
        raise SoftprintError(
            "--sample and --contact are for the truth and exclude --motion: give one of the two"
        )
    body = body_of_run(context)
    if args.motion is not None:
        motion = load_motion(context.out_dir / "motions" / f"{args.motion}.h5")
        if motion.body_hash != body.content_hash:
            raise SoftprintError(f"{motion.path}: is a motion of a body other than {body.name!r}")
        with context.stage("building colliders"):
            colliders = build_colliders(motion.collider_tables, motion.path)
        frames = args.frame if args.frame is not None else list(range(motion.n_frames))
        return _write(context, body, args.motion, len(frames), deformed_frames(motion, colliders, frames))
    with load_truth(context.out_dir / "truth.h5", body) as truth:
        require_same_colliders(truth, context.experiment)
        samples = _samples(truth, args)
        contacts = [int(truth.samples["contact"][k]) for k in samples if 0 <= k < truth.n_samples]
        names = {truth.header.colliders[truth.contacts["collider"][contact]] for contact in contacts}
        with context.stage("building colliders"):
            colliders = _colliders(context, names)
        return _write(context, body, "truth", len(samples), deformed_samples(truth, body, colliders, samples))


def _colliders(context: Context, names: Iterable[str]) -> dict[str, Collider]:
    """The colliders of these names that are in the experiment."""
    from softprint.runtime.colliders.build import build_collider

    experiment = context.experiment
    known = [name for name in names if name in experiment.collider_names]
    return {name: build_collider(experiment.collider(name), experiment.base_dir) for name in known}


def _samples(truth: TruthData, args: argparse.Namespace) -> list[int]:
    """The requested samples, in order and without repeats."""
    import numpy as np

    from softprint.runtime.errors import SoftprintError
    from softprint.runtime.truth.truth_schema import CONVERGED

    converged = truth.samples["status"] == CONVERGED
    if args.sample is None and args.contact is None:
        if not converged.any():
            raise SoftprintError(f"{truth.path}: no sample has converged, so there is nothing to show")
        return [int(np.argmax(np.where(converged, truth.samples["depth"], -np.inf)))]
    chosen = set(args.sample or [])
    if args.contact is not None:
        if not 0 <= args.contact < len(truth.contacts):
            last = len(truth.contacts) - 1
            raise SoftprintError(f"{truth.path}: no contact {args.contact}; they are numbered 0 to {last}")
        chosen |= set(np.flatnonzero((truth.samples["contact"] == args.contact) & converged).tolist())
        if not chosen:
            raise SoftprintError(f"{truth.path}: no sample of contact {args.contact} has converged")
    return sorted(chosen)


def _write(context: Context, body: ReducedBody, name: str, count: int, series: Iterable[Deformed]) -> int:
    from softprint.runtime.contact import PenaltyContact
    from softprint.runtime.fields.series import write_series

    contact = PenaltyContact.of(context.experiment.contact)
    with context.progress(count, "files", "fields") as bar:
        path = write_series(context.out_dir / FOLDER, name, body, contact, series, bar.update)
    context.say(f"{path}: {count} {'step' if count == 1 else 'steps'} for ParaView")
    return 0


VERB = Verb(
    name="fields",
    order=45,
    summary="Strain, stress and contact pressure of samples or frames, as files for ParaView.",
    example="softprint fields examples/jelly3d_small.toml --contact 7",
    run=run,
    needs=("h5py",),
    configure=configure,
)
