"""What every verb is handed: the experiment, where to write, and how to speak."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

from runtime.cli.progress import Progress
from runtime.cli.ranks import launched_rank
from runtime.errors import SoftprintError

if TYPE_CHECKING:
    from runtime.experiment import Experiment


@dataclass
class Context:
    """One run of one verb.

    experiment_path: the file, None for verbs that take none; overrides: `--set`; out: `--out`; quiet: log
    lines instead of progress bars; resume: keep what an earlier run finished; rank: of this process under
    mpirun.
    """

    experiment_path: Path | None = None
    overrides: tuple[str, ...] = ()
    out: Path | None = None
    quiet: bool = False
    resume: bool = True
    rank: int = field(default_factory=launched_rank)
    write: Callable[[str], None] = print

    @cached_property
    def experiment(self) -> Experiment:
        """The experiment, read and checked when first asked for."""
        from runtime.experiment import load_experiment

        if self.experiment_path is None:
            raise SoftprintError("this verb takes no experiment file")
        return load_experiment(self.experiment_path, self.overrides)

    @property
    def seed(self) -> int:
        """The experiment's seed, `--seed` included."""
        return self.experiment.seed

    @cached_property
    def out_dir(self) -> Path:
        """The run directory (`--out`, or runs/NAME), made when first asked for."""
        out = self.out or Path("runs") / self.experiment.name
        try:
            out.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise SoftprintError(f"cannot make the output folder {out}: {error.strerror}") from error
        return out

    def say(self, text: str) -> None:
        """Print for the user, on the first rank only."""
        if self.rank == 0:
            self.write(text)

    def progress(self, total: int | None, unit: str = "it", desc: str = "") -> Progress:
        """A progress bar with a rate and an ETA; use it in a `with`, and call `update(n)` on it.

        On other ranks it says nothing; with --quiet, or where the output is no terminal, it logs a line now
        and then.
        """
        return Progress(total, unit=unit, desc=desc, quiet=self.quiet, silent=self.rank != 0)
