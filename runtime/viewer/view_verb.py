"""`softprint view`: a window in the browser, to press a body by hand, or to play motions and samples."""

from __future__ import annotations

import argparse
from pathlib import Path

from softprint.runtime.cli.context import Context, run_directory
from softprint.runtime.cli.verb import Verb

PORT = 8712


def configure(parser: argparse.ArgumentParser) -> None:
    """What to show, and where."""
    parser.add_argument(
        "what",
        nargs="+",
        type=Path,
        metavar="FILE",
        help="an experiment file, to press its body by hand; or motion files, which play beside each other; or a truth "
        "file, for its samples",
    )
    parser.add_argument(
        "--set",
        dest="overrides",
        action="append",
        default=[],
        metavar="KEY=VALUE",
        help="change one key of the experiment, as in --set dynamics.max_iterations=4; repeatable",
    )
    parser.add_argument(
        "--out", type=run_directory, metavar="DIR", help="run directory (default: runs/NAME_OF_EXPERIMENT)"
    )
    parser.add_argument(
        "--scene",
        metavar="NAME",
        help='the scene whose colliders and handles to begin with (default: the first with role = "test")',
    )
    parser.add_argument(
        "--model",
        action="append",
        metavar="NAME",
        help="bare, condensed, or a trained correction; given twice, both play side by side (default: the first of "
        "ours, mechanics, bare that there is)",
    )
    parser.add_argument(
        "--colliders",
        type=Path,
        metavar="EXPERIMENT.toml",
        help="draw the colliders of this experiment with the samples of a truth file; a motion file contains its own",
    )
    parser.add_argument("--port", type=int, default=PORT, metavar="N", help="0: any free one")
    parser.add_argument(
        "--open",
        action=argparse.BooleanOptionalAction,
        default=True,
        help="open the page in a browser (default: on)",
    )


def run(args: argparse.Namespace, context: Context) -> int:
    """Serve the page until Ctrl-C."""
    from softprint.runtime.errors import SoftprintError

    experiments = [path for path in args.what if path.suffix == ".toml"]
    if not experiments:
        from softprint.runtime.viewer.playback.page import play_files

        refused = [name for name in ("scene", "model", "overrides", "out") if getattr(args, name)]
        if refused:
            raise SoftprintError(f"--{refused[0].replace('overrides', 'set')} belongs to an experiment file")
        play_files(args.what, args.colliders, args.port, args.open, context)
        return 0
    if len(args.what) > 1:
        raise SoftprintError(
            "one experiment at a time can be pressed by hand; motion files have their own window"
        )
    from softprint.runtime.viewer.live import press_by_hand

    own = Context(experiments[0], tuple(args.overrides), args.out, context.quiet, rank=context.rank)
    press_by_hand(own, args.scene, args.model, args.port, args.open)
    return 0


VERB = Verb(
    name="view",
    order=43,
    summary="Press a body by hand in a window, or play motions and samples there.",
    example="softprint view examples/jelly3d_small.toml",
    run=run,
    needs=("h5py", "viser"),
    configure=configure,
    reads_experiment=False,
)
