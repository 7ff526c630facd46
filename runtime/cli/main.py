"""`softprint VERB ...`: reads the command line, runs the verb, and reports errors as sentences.

Exit status: 0 success; 1 an error that the user can fix, reported on stderr; 2 a bad command line; 130 Ctrl-C.
"""

from __future__ import annotations

import argparse
import logging
import os
import signal
import sys
import time
import traceback
from collections.abc import Sequence
from pathlib import Path

from softprint.runtime.cli.context import Context, run_directory
from softprint.runtime.cli.discover import FoundVerb, find_verbs
from softprint.runtime.cli.progress import LogHandler, tell_failure
from softprint.runtime.cli.ranks import end_all_ranks, launched_rank
from softprint.runtime.cli.verb import Verb
from softprint.runtime.errors import SoftprintError
from softprint.runtime.linalg.openmp_waiting import wait_briefly

PATIENCE = 2.0  # s that the other ranks wait for the first one to report the error
_STOPPED = "Stopped. Nothing half-written is left."
_STOPPED_RUN = (
    "Stopped. Finished work is kept: the same command continues from there. (With --no-resume it starts again.)"
)
DESCRIPTION = "Press things into soft bodies: solve once with finite elements, learn, then run in real time."


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command line; returns the exit status."""
    if arguments is None:  # we own the process; mpirun and batch systems stop it with SIGTERM
        signal.signal(signal.SIGTERM, signal.default_int_handler)
        wait_briefly()
    try:
        status = _main(arguments)
        sys.stdout.flush()
        return status
    except BrokenPipeError:  # the reader of our output, such as `head`, has closed it
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 1
    except KeyboardInterrupt:
        if arguments is None:  # handled once: mpirun repeats the signal
            for again in (signal.SIGINT, signal.SIGTERM):
                signal.signal(again, signal.SIG_IGN)
        _refuse(_stopped(sys.argv[1:] if arguments is None else arguments), launched_rank())
        end_all_ranks(130)
        return 130


def _stopped(words: Sequence[str]) -> str:
    """What is said where a command was stopped: verbs with an experiment keep what they have finished."""
    keeps = {found.name for found in find_verbs() if found.verb is not None and found.verb.reads_experiment}
    return _STOPPED_RUN if set(words[:1]) & keeps else _STOPPED


def _main(arguments: Sequence[str] | None) -> int:
    verbs = find_verbs()
    parser = build_parser(verbs)
    options = parser.parse_args(arguments)
    if options.verb is None:
        parser.print_help()
        return 2
    rank = launched_rank()
    _set_up_logging(rank, options.debug)
    found = next(verb for verb in verbs if verb.name == options.verb)
    if found.verb is None or found.unavailable:
        return _refuse(f"softprint {found.name}: {found.unavailable}", rank)
    return _run(found.verb, options, rank)


def build_parser(verbs: Sequence[FoundVerb]) -> argparse.ArgumentParser:
    """The whole command line: general options, and a sub-parser for each verb."""
    parser = argparse.ArgumentParser(
        prog="softprint",
        description=DESCRIPTION,
        epilog="softprint VERB --help shows the options of a verb, their defaults and an example.",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.set_defaults(debug=False)
    subparsers = parser.add_subparsers(
        dest="verb", metavar="VERB", title="verbs, in the order of the workflow"
    )
    for found in verbs:
        _add_verb(subparsers, found)
    return parser


def _add_verb(subparsers: argparse._SubParsersAction[argparse.ArgumentParser], found: FoundVerb) -> None:
    verb = found.verb
    summary = verb.summary if verb else ""
    note = f"(not available here: {found.unavailable})" if found.unavailable else ""
    about = f"{summary} {note}".strip()
    example = f"example:\n  {verb.example}" if verb else ""
    parser = subparsers.add_parser(
        found.name,
        help=about.replace("%", "%%"),
        description=about,
        epilog=example,
        formatter_class=_HelpFormatter,
    )
    if verb is None:
        parser.add_argument("rest", nargs=argparse.REMAINDER, help=argparse.SUPPRESS)
    else:
        if verb.reads_experiment:
            _add_experiment_options(parser)
        verb.configure(parser)
    parser.add_argument(
        "--quiet", action="store_true", help="log lines instead of progress bars (default: off)"
    )
    parser.add_argument("--debug", action="store_true", help="log more, and show tracebacks (default: off)")


def _add_experiment_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("experiment", type=Path, metavar="EXPERIMENT.toml", help="the experiment file")
    parser.add_argument(
        "--set",
        dest="overrides",
        action="append",
        default=[],
        metavar="KEY=VALUE",
        help="change one key of the experiment, as in --set sampling.places=8; repeatable",
    )
    parser.add_argument("--seed", type=int, metavar="N", help="short for --set experiment.seed=N")
    parser.add_argument(
        "--out", type=run_directory, metavar="DIR", help="run directory (default: runs/NAME_OF_EXPERIMENT)"
    )
    parser.add_argument(
        "--resume",
        action=argparse.BooleanOptionalAction,
        default=True,
        help="keep finished results of an earlier run in the same directory (default: on)",
    )


class _HelpFormatter(argparse.RawDescriptionHelpFormatter):
    """Shows the default of every option that has one, unless its help already names it."""

    def _get_help_string(self, action: argparse.Action) -> str | None:
        text = action.help
        as_is = text is None or "default" in text or text == argparse.SUPPRESS
        if as_is or action.default in (None, argparse.SUPPRESS, []) or not action.option_strings:
            return text
        return f"{text} (default: %(default)s)"


def _run(verb: Verb, options: argparse.Namespace, rank: int) -> int:
    try:
        return verb.run(options, _context(verb, options, rank))
    except SoftprintError as error:
        if options.debug:
            traceback.print_exc()
        status = _refuse(str(error), rank)
        end_all_ranks(status)
        return status
    except BrokenPipeError:
        raise
    except Exception as error:
        if _is_interrupt(error):
            raise KeyboardInterrupt from error
        # A bug: show the traceback, then end all ranks so that none waits for this one.
        traceback.print_exc()
        end_all_ranks(1)
        raise


def _is_interrupt(error: BaseException | None) -> bool:
    """Whether this is an interrupt, or what Python makes of one that comes within a compiled function: a SystemError,
    "returned a result with an exception set", with the interrupt as its cause."""
    while isinstance(error, SystemError):
        error = error.__cause__
    return isinstance(error, KeyboardInterrupt)


def _context(verb: Verb, options: argparse.Namespace, rank: int) -> Context:
    if not verb.reads_experiment:
        return Context(quiet=options.quiet, rank=rank)
    overrides = list(options.overrides)
    if options.seed is not None:
        overrides.append(f"experiment.seed={options.seed}")
    return Context(
        experiment_path=options.experiment,
        overrides=tuple(overrides),
        out=options.out,
        quiet=options.quiet,
        resume=options.resume,
        rank=rank,
    )


def _refuse(message: str, rank: int) -> int:
    """Report an error on stderr; an error common to all ranks of an MPI run is reported by the first only."""
    if rank > 0:
        time.sleep(PATIENCE)  # if the first rank has the same error, it ends this one meanwhile
        message = f"rank {rank}: {message}"
    tell_failure(message)
    print(message, file=sys.stderr, flush=True)
    return 1


def _set_up_logging(rank: int, debug: bool) -> None:
    level = logging.DEBUG if debug else logging.INFO if rank == 0 else logging.WARNING
    logging.basicConfig(level=level, format="%(message)s", handlers=[LogHandler(sys.stderr)])
    # Progress is logged where a verb has silenced the rest.
    logging.getLogger(LogHandler.__module__).setLevel(level)
    for chatty in ("matplotlib", "h5py", "FFCx", "UFL", "numba", "PIL", "trimesh"):
        logging.getLogger(chatty).setLevel(logging.WARNING)


if __name__ == "__main__":
    sys.exit(main())
