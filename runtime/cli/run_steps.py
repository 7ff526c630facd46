"""The steps from an experiment file to its report, each a verb in a process of its own: `softprint run`.

Each process tells how far it is by lines in a file (`runtime/cli/progress.py`), from which one bar is drawn.
"""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import IO

from softprint.runtime.cli.context import Context
from softprint.runtime.cli.progress import FAILED, FOLLOWED
from softprint.runtime.errors import SoftprintError
from softprint.runtime.experiment import ModelSpec
from softprint.runtime.forked_workers import worker_count
from softprint.runtime.learned.registry import FORMS

_LOOK = 0.5  # s between two looks at a process
_PATIENCE = 20.0  # s for a process to end itself after Ctrl-C
_WHOLE = 100  # units of the bar
# Networks of a model with mechanics below it: on parts of the samples, and on all (`surrogate/cross_validation.py`).
_NETWORKS = 5
LOG = "run.log"  # in the run directory: all that the processes print


@dataclass(frozen=True)
class Step:
    """A verb with its own options. share: of the whole time, about; counted, bars: what its long bars count, and how
    many it shows; ranks: of MPI; threads: of each."""

    verb: str
    share: float
    options: Sequence[str] = ()
    counted: tuple[str, ...] = ()
    bars: int = 1
    ranks: int = 1
    threads: int = 1


def steps_of(context: Context, ranks: int, pictures: bool = True) -> list[Step]:
    """Body, reference solutions, training, motions of every model in the test scenes, and the report. pictures: whether
    it has renderings."""
    experiment = context.experiment
    trained, internal = experiment.training.models, experiment.training.internal
    names = ["full", "bare", *(model.name for model in trained)]
    if internal:
        names += ["condensed", *(model.name for model in internal)]
    scenes = len(experiment.scenes_of_role("test"))
    models = [word for name in names for word in ("--model", name)]
    cores = worker_count(len(os.sched_getaffinity(0)))
    judged = len(trained) if len(experiment.sampled_colliders) > 1 else 0  # by shape, too
    return [
        Step("body", 0.03),
        Step(
            "generate", 0.45, counted=("contacts" if experiment.sampled_colliders else "states",), ranks=ranks
        ),
        Step(
            "train",
            0.25,
            counted=("step",),
            bars=sum(map(_networks, trained)) + len(internal),
            threads=cores,
        ),
        Step("simulate", 0.15, models, counted=("steps",), bars=scenes * len(names)),
        Step(
            "report",
            0.12,
            () if pictures else ("--no-pictures",),
            counted=("frames", "sample"),
            bars=scenes + judged,
            threads=cores,
        ),
    ]


def _networks(model: ModelSpec) -> int:
    """How many networks are trained for a model."""
    if not model.learned:
        return 0
    return _NETWORKS if FORMS[model.form].on_mechanics else 1


def usable_ranks(wanted: int | None) -> int:
    """How many ranks `generate` gets: one where there is no mpirun. Raises SoftprintError for less than one."""
    if wanted is not None and wanted < 1:
        raise SoftprintError(f"--ranks {wanted}: must be at least 1")
    if shutil.which("mpirun") is None:
        if wanted is not None and wanted > 1:
            raise SoftprintError(
                f"--ranks {wanted} needs mpirun, which is not installed (Debian: openmpi-bin)"
            )
        return 1
    return wanted or len(os.sched_getaffinity(0))


def run_steps(context: Context, steps: Sequence[Step]) -> None:
    """Run all steps. Raises SoftprintError with the sentence of the first that fails. What
    is finished is kept."""
    log = context.out_dir / LOG
    log.write_text("")
    done = 0.0
    with context.progress(_WHOLE, "%", "all steps") as bar:
        for number, step in enumerate(steps, start=1):
            title = f"{number}/{len(steps)} {step.verb}"
            for share, note in _run(context, step, log):
                whole = int(_WHOLE * (done + step.share * share))
                bar.update(max(whole - bar.count, 0), f"{title} {note}")
            done += step.share
            bar.update(max(round(_WHOLE * done) - bar.count, 0), title)


def _run(context: Context, step: Step, log: Path) -> Iterator[tuple[float, str]]:
    """Runs a step, and yields the finished share of it and a note, until it ends."""
    with tempfile.TemporaryDirectory(prefix="softprint-run-") as folder, log.open("ab") as output:
        followed = Path(folder) / "progress"
        followed.touch()
        with _process(_command(context, step), _environment(step, followed), output) as process:
            while process.poll() is None:
                time.sleep(_LOOK)
                yield how_far(followed.read_text(encoding="utf-8"), step)
        told = followed.read_text(encoding="utf-8")
    if process.returncode:
        why = why_failed(told) or _last_line(log) or f"exit status {process.returncode}"
        raise SoftprintError(f"softprint {step.verb}: {why} ({log} has all that was said)")


def why_failed(told: str) -> str:
    """The first reason that a process has told, of several ranks the one that failed first; empty without any."""
    reasons = (line.partition("\t") for line in told.splitlines())
    return next((why for kind, _, why in reasons if kind == FAILED), "")


def _last_line(log: Path) -> str:
    lines = log.read_text(errors="replace").strip().splitlines()
    return lines[-1] if lines else ""


def _command(context: Context, step: Step) -> list[str]:
    """The command line of a step."""
    words = [sys.executable, "-m", "softprint.runtime.cli.main", step.verb, str(context.experiment_path)]
    words += ["--out", str(context.out_dir), "--quiet", *step.options]
    words += [word for setting in context.overrides for word in ("--set", setting)]
    if not context.resume:
        words.append("--no-resume")
    if step.ranks > 1:
        words = ["mpirun", "--oversubscribe", "-n", str(step.ranks), *words]
    return words


def _environment(step: Step, followed: Path) -> Mapping[str, str]:
    """One thread for each rank and for simulations, and of BLAS: small matrices do not gain from more. Open MPI runs as
    root, for instance in a container, only with both of its variables set."""
    threads = {"OMP_NUM_THREADS": str(step.threads), "OPENBLAS_NUM_THREADS": "1"}
    as_root = (
        {"OMPI_ALLOW_RUN_AS_ROOT": "1", "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM": "1"} if os.getuid() == 0 else {}
    )
    return {**os.environ, **threads, **as_root, FOLLOWED: str(followed)}


@contextmanager
def _process(
    command: Sequence[str], environment: Mapping[str, str], output: IO[bytes]
) -> Iterator[subprocess.Popen[bytes]]:
    """A process that is stopped, and waited for, when the block is left early."""
    process = subprocess.Popen(
        command,
        env=environment,
        stdin=subprocess.DEVNULL,
        stdout=output,
        stderr=subprocess.STDOUT,
        start_new_session=True,
    )
    try:
        yield process
    finally:
        if process.poll() is None:
            process.send_signal(signal.SIGINT)
            try:
                process.wait(_PATIENCE)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()


def how_far(told: str, step: Step) -> tuple[float, str]:
    """The finished share of a step, by its long bars, and what it does, from the lines that its process has told."""
    lines = [fields for line in told.splitlines() if len(fields := line.split("\t")) == 4]
    if not lines:
        return 0.0, ""
    long = [fields for fields in lines if fields[2] in step.counted and int(fields[1])]
    begun = len({fields[3] for fields in long})
    share = (begun - 1 + int(long[-1][0]) / int(long[-1][1])) / max(step.bars, begun) if long else 0.0
    count, total, unit, desc = lines[-1]
    return min(share, 1.0), f"({desc}, {count}/{total} {unit})" if int(total) else f"({desc})"


def errors_left(run: Path) -> list[str]:
    """A line for each model, from report.json: what it leaves of the error of the reduced model alone, in motions that
    training has not seen."""
    report = json.loads((run / "report.json").read_text(encoding="utf-8"))
    rows = {name: row for name, row in report.get("errors", {}).items() if row and name != "full"}
    if not rows:
        return ["No held-out scene could be judged; the report says why."]
    frames = max(int(row["n_frames"]) for row in rows.values())
    width = max(map(len, rows))
    where = "frames in contact" if report.get("collider") else "frames"
    return [
        f"Error left in {frames} {where} of motions never seen (relative RMS):",
        *(f"  {name:<{width}}  {row['relative_rms']:.1%}" for name, row in rows.items()),
    ]
