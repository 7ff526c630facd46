"""`softprint inspect`: the kind, origin, quality and picture of a file."""

from __future__ import annotations

import argparse
from pathlib import Path

from softprint.runtime.cli.context import Context
from softprint.runtime.cli.verb import Verb


def configure(parser: argparse.ArgumentParser) -> None:
    """The file, the part of it, and the form of the output."""
    parser.add_argument(
        "file", type=Path, metavar="FILE", help="any file of Softprint's, a mesh or a collider"
    )
    parser.add_argument("--sample", type=int, metavar="K", help="a sample of a truth file")
    parser.add_argument("--frame", type=int, metavar="K", help="a frame of a motion")
    parser.add_argument("--json", action="store_true", help="as JSON (default: off)")
    parser.add_argument(
        "--experiment",
        action="store_true",
        help="print the experiment it was made from, as text (default: off)",
    )
    parser.add_argument("--png", type=Path, metavar="PICTURE.png", help="draw it, off screen")
    parser.add_argument(
        "--colliders",
        type=Path,
        metavar="EXPERIMENT.toml",
        help="draw the colliders of this experiment with a sample; a motion file contains its own",
    )


def run(args: argparse.Namespace, context: Context) -> int:
    """Print the summary, or the experiment; draw the picture."""
    from softprint.runtime.errors import SoftprintError
    from softprint.runtime.inspect.kind import Part, inspect_file
    from softprint.runtime.inspect.picture import picture_of

    if args.colliders is not None and args.png is None:
        raise SoftprintError("--colliders is for pictures: add --png PICTURE.png")
    part = Part(args.sample, args.frame)
    with context.stage(f"reading {args.file.name}"):
        summary = inspect_file(args.file, part)
    if args.experiment:
        if summary.experiment is None:
            raise SoftprintError(
                f"{args.file}: {summary.kind} does not contain the experiment it was made from"
            )
        context.say(summary.experiment.rstrip("\n"))
    else:
        context.say(summary.as_json() if args.json else summary.as_text())
    if args.png is not None:
        with context.stage("drawing"):
            picture_of(args.file, part, args.png, args.colliders)
    return 0


VERB = Verb(
    name="inspect",
    order=70,
    summary="Show the kind, origin and quality of a file; draw it.",
    example="softprint inspect runs/jelly3d_small/truth.h5 --sample 4 --png sample.png",
    run=run,
    needs=("h5py",),
    configure=configure,
    reads_experiment=False,
)
