"""Kill `mpirun -n 2 softprint generate` at random times, fill its disk, and check the remaining files.

    python -m tests.kill_generate --kills 100      # and, as root, --full-disk

Runs continue in the same folder, one after the other, until a truth is complete; then a new folder is used, until
all kills are done. Three targets are killed in turn: all processes, one rank, mpirun alone; four times out of five only
after some more contacts are finished, and every fourth time only while a file is being written. After each kill no
temporary file may have its final name, every finished contact must still exist and never be solved again, and every
truth must have the same content as that of an undisturbed run.
"""

from __future__ import annotations

import argparse
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from softprint.fem_truth.generate.shards import is_whole
from softprint.runtime.truth.truth_file import load_truth
from tests.toy_experiment import write_experiment

REPOSITORY = Path(__file__).resolve().parent.parent
WHAT = ("everything", "one rank", "mpirun")
PATIENCE = 120.0  # s: time limit of every process
TEMPORARY = ".*-[0-9a-f]*.*"  # name patterns of temporary files


def environment() -> dict[str, str]:
    """Environment for MPI runs as any user, with one thread per rank."""
    return {
        **os.environ,
        "PYTHONPATH": str(REPOSITORY),
        "OMP_NUM_THREADS": "1",
        "OMPI_ALLOW_RUN_AS_ROOT": "1",
        "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM": "1",
    }


@dataclass
class Generation:
    """A command that generates into a folder."""

    experiment: Path
    out: Path
    options: Sequence[str] = ()
    ranks: int = 2

    @property
    def command(self) -> list[str]:
        launcher = ["mpirun", "--oversubscribe", "-n", str(self.ranks)] if self.ranks > 1 else []
        return [
            *launcher,
            *(sys.executable, "-m", "softprint.runtime.cli.main", "generate", str(self.experiment)),
            *("--out", str(self.out), "--quiet", *self.options),
        ]

    def start(self) -> subprocess.Popen[str]:
        return subprocess.Popen(
            self.command,
            env=environment(),
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            text=True,
            start_new_session=True,
        )

    def run(self) -> subprocess.CompletedProcess[str]:
        """Run to the end, undisturbed."""
        return subprocess.run(
            self.command,
            env=environment(),
            capture_output=True,
            text=True,
            timeout=PATIENCE,
            check=False,
        )

    def shards(self) -> dict[Path, int]:
        """Finished contacts, and their modification times [ns]; without those that are being removed."""
        found = {}
        for path in self.out.glob("shards/contact_*.shard"):
            with suppress(FileNotFoundError):
                found[path] = path.stat().st_mtime_ns
        return found

    def temporaries(self) -> set[Path]:
        """Files that are being written now, or were when their writer was killed."""
        return {path for folder in (self.out, self.out / "shards") for path in folder.glob(TEMPORARY)}

    def content_hash(self) -> str | None:
        """Content hash of a complete truth; None if there is none yet. Raises SoftprintError for a damaged one."""
        if not (self.out / "truth.h5").exists():
            return None
        with load_truth(self.out / "truth.h5") as truth:
            return truth.content_hash if truth.complete else None


@dataclass
class Storm:
    """Effects of the kills. lost: finished contacts that were missing, damaged or solved again."""

    kills: Counter[str] = field(default_factory=Counter)
    truths: int = 0
    different: int = 0
    lost: int = 0
    kept: int = 0
    in_writing: int = 0
    too_late: int = 0
    complaints: list[str] = field(default_factory=list)

    @property
    def is_harmless(self) -> bool:
        return not (self.different or self.lost or self.complaints)

    def __str__(self) -> str:
        killed = ", ".join(f"{what} {count}" for what, count in self.kills.items())
        lines = [
            f"{self.kills.total()} kills ({killed}), {self.in_writing} while a file was written; "
            f"{self.too_late} more came after the end",
            f"{self.truths} truths finished, {self.different} of them different from the undisturbed one",
            f"{self.kept} finished contacts found again after a kill, {self.lost} lost",
            *(f"complaint: {complaint}" for complaint in self.complaints),
        ]
        return "\n".join(lines)


def kill_storm(
    experiment: Path,
    folder: Path,
    kills: int,
    seed: int,
    wanted: str,
    duration: float,
    options: Sequence[str] = (),
) -> Storm:
    """Kill generations under ``folder`` this many times, at times drawn from ``duration`` [s], and finish the last
    one. wanted: content hash of the undisturbed truth."""
    storm, rng = Storm(), np.random.default_rng(seed)
    runs = (Generation(experiment, folder / f"run_{number}", options) for number in range(10**6))
    run = next(runs)
    while (number := storm.kills.total()) < kills:
        before = run.shards()
        by_progress = number % 5 != 4
        moment = Moment(
            delay=float(rng.uniform(0.0, 0.05 if by_progress else duration)),
            contacts=len(before) + int(rng.integers(1, 4)) if by_progress else 0,
            writing=number % 4 == 3,
        )
        killed = _kill_once(run, WHAT[number % 3], moment, storm)
        if not killed:
            storm.too_late += 1
        _judge(run, before, storm)
        if run.content_hash() is not None:
            _finish(run, wanted, storm)
            print(
                f"{storm.kills.total()} kills, {storm.truths} truths, {storm.lost} contacts lost", flush=True
            )
            run = next(runs)
    _finish(run, wanted, storm)
    return storm


@dataclass(frozen=True)
class Moment:
    """When to kill: ``delay`` [s] after this many contacts are finished, and, if ``writing``, only while a file is
    being written."""

    delay: float
    contacts: int
    writing: bool


def _kill_once(run: Generation, what: str, moment: Moment, storm: Storm) -> bool:
    """Whether the process was still running when it was killed."""
    left = run.temporaries()
    process = run.start()
    while process.poll() is None and len(run.shards()) < moment.contacts:
        time.sleep(0.001)
    end = time.monotonic() + moment.delay
    while process.poll() is None and time.monotonic() < end:
        time.sleep(0.001)
    while moment.writing and process.poll() is None and run.temporaries() <= left:
        time.sleep(0.0002)
    members = _session(process.pid)
    victims = {"everything": members, "mpirun": [process.pid], "one rank": members[-1:]}[what]
    killed = process.poll() is None
    if killed:
        storm.in_writing += not run.temporaries() <= left
        for pid in victims:
            _kill(pid)
        storm.kills[what] += 1
    said = process.communicate(timeout=PATIENCE)[1]
    patience = time.monotonic() + PATIENCE
    while _session(process.pid):  # ranks that mpirun left behind end by themselves
        if time.monotonic() > patience:
            storm.complaints.append(f"ranks outlived {what}")
            for pid in _session(process.pid):
                _kill(pid)
        time.sleep(0.01)
    if not killed and process.returncode != 0:
        storm.complaints.append(f"undisturbed, it ended with {process.returncode}: {said.strip()[-300:]}")
    if "Traceback" in said:
        storm.complaints.append(said[said.index("Traceback") :][-300:])
    return killed


def _session(leader: int) -> list[int]:
    """Processes of the session of ``leader`` that are alive, in the order of their start: mpirun, then the
    ranks."""
    found = []
    for entry in Path("/proc").iterdir():
        if entry.name.isdigit():
            try:
                state, _, _, session = (entry / "stat").read_text().rpartition(")")[2].split()[:4]
            except (OSError, ValueError):
                continue
            if int(session) == leader and state != "Z":
                found.append(int(entry.name))
    return sorted(found)


def _kill(pid: int) -> None:
    with suppress(ProcessLookupError):
        os.kill(pid, signal.SIGKILL)


def _judge(run: Generation, before: dict[Path, int], storm: Storm) -> None:
    """Check after a kill that everything finished before is unchanged, and that new files are complete."""
    if run.content_hash() is not None:
        return  # the shards were merged into the truth
    now = run.shards()
    lost = [path for path, written in before.items() if now.get(path) != written]
    storm.lost += len(lost) + sum(not is_whole(path) for path in now)
    storm.kept += len(before) - len(lost)


def _finish(run: Generation, wanted: str, storm: Storm) -> None:
    before = run.shards()
    done = run.run()
    if done.returncode != 0:
        storm.complaints.append(f"not resumed ({done.returncode}): {done.stderr.strip()[-300:]}")
        return
    storm.truths += 1
    storm.kept += len(before)
    storm.different += run.content_hash() != wanted
    left = sorted(path.name for path in run.out.iterdir())
    if left != [".generate.lock", "body.h5", "truth.h5", "truth.xdmf"]:
        storm.complaints.append(f"left behind: {left}")


@contextmanager
def small_disk(folder: Path, size: int) -> Iterator[None]:
    """A disk of ``size`` bytes mounted at a folder; needs root."""
    folder.mkdir(parents=True)
    subprocess.run(["mount", "-t", "tmpfs", "-o", f"size={size}", "tmpfs", folder], check=True)
    try:
        yield
    finally:
        subprocess.run(["umount", folder], check=True)


def full_disk(experiment: Path, folder: Path, wanted: str, needed: int, options: Sequence[str] = ()) -> None:
    """Generate onto disks that are too small by different amounts; each time add space and resume."""
    for share in (0.02, 0.1, 0.2, 0.4, 0.6, 0.8, 0.95):
        size, disk = int(share * needed) // 4096 * 4096, folder / f"disk_{share}"
        with small_disk(disk, size):
            run = Generation(experiment, disk / "run", options)
            full = run.run()
            files = sorted(path.relative_to(disk).as_posix() for path in disk.rglob("*") if path.is_file())
            said = full.stderr.strip().splitlines()
            told = [line for line in said if "No space left" in line]
            print(f"disk of {share:.0%} of {needed} bytes: status {full.returncode}; {len(files)} files left")
            print(f"   {told[0] if told else said}")
            assert full.returncode != 0
            assert told
            assert "Traceback" not in full.stderr
            assert not run.temporaries()
            assert all(is_whole(path) for path in run.shards())
            before = run.shards()
            subprocess.run(["mount", "-o", f"remount,size={8 * needed}", disk], check=True)
            more = run.run()
            same = run.content_hash() == wanted
            print(
                f"   with room, going on from {len(before)} contacts: status {more.returncode}, same truth: {same}"
            )
            assert more.returncode == 0, more.stderr
            assert same


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--kills", type=int, default=100)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--full-disk", action="store_true", help="fill a disk, too; as root")
    arguments = parser.parse_args()
    options = ("--set", "sampling.rotations=8")
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        experiment = write_experiment(folder, 2)
        reference = Generation(experiment, folder / "reference", options)
        began = time.monotonic()
        reference.run().check_returncode()
        duration = time.monotonic() - began
        wanted = reference.content_hash()
        assert wanted is not None
        print(f"undisturbed: {duration:.1f} s, content {wanted[:16]}", flush=True)
        storm = kill_storm(experiment, folder, arguments.kills, arguments.seed, wanted, duration, options)
        print(storm, flush=True)
        if arguments.full_disk:
            needed = 2 * (reference.out / "truth.h5").stat().st_size
            full_disk(experiment, folder, wanted, needed, options)
    return 0 if storm.is_harmless else 1


if __name__ == "__main__":
    sys.exit(main())
