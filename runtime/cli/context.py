"""The context of a verb: the experiment, the run directory, and output to the user."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

from softprint.runtime.cli.progress import Progress, Stage, print_beside_bars
from softprint.runtime.cli.ranks import launched_rank
from softprint.runtime.errors import SoftprintError

if TYPE_CHECKING:
    from softprint.runtime.experiment import Experiment


def run_directory(text: str) -> Path:
    """The argument of `--out`. An empty one, as of a shell variable that is not set, would be the present folder."""
    if not text.strip():
        raise argparse.ArgumentTypeError("the name of the run directory is empty: give one, or leave --out away")
    return Path(text)


@dataclass
class Context:
    """One run of one verb.

    experiment_path: the file, None for verbs without one; overrides: `--set`; out: `--out`; quiet: log
    lines instead of progress bars; resume: keep the results of an earlier run; rank: of this process under mpirun.
    """

    experiment_path: Path | None = None
    overrides: tuple[str, ...] = ()
    out: Path | None = None
    quiet: bool = False
    resume: bool = True
    rank: int = field(default_factory=launched_rank)
    write: Callable[[str], None] = print_beside_bars

    @cached_property
    def experiment(self) -> Experiment:
        """The experiment, read and checked on first use."""
        from softprint.runtime.experiment import load_experiment

        if self.experiment_path is None:
            raise SoftprintError("this verb takes no experiment file")
        return load_experiment(self.experiment_path, self.overrides)

    @property
    def seed(self) -> int:
        """The experiment's seed, `--seed` included."""
        return self.experiment.seed

    @cached_property
    def out_dir(self) -> Path:
        """The run directory (`--out`, or runs/NAME), created on first use."""
        out = self.out or Path("runs") / self.experiment.name
        try:
            out.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise SoftprintError(f"cannot make the output folder {out}: {error.strerror}") from error
        return out

    def say(self, text: str) -> None:
        """Print to the user, on the first rank only."""
        if self.rank == 0:
            self.write(text)

    def progress(self, total: int | None, unit: str = "it", desc: str = "") -> Progress:
        """A progress bar with a rate and an ETA; a context manager with `update(n)`.

        On other ranks it is silent; with --quiet, or if the output is not a terminal, it logs a line at intervals.
        """
        return Progress(total, unit=unit, desc=desc, quiet=self.quiet, silent=self.rank != 0)

    def stage(self, desc: str) -> Stage:
        """A clock for work that is not counted, as a context manager; silent as `progress` is."""
        return Stage(desc, quiet=self.quiet, silent=self.rank != 0)
