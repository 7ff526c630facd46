"""Does a second rank double the truth? Throughput and memory of `softprint generate` on one rank and on two.

    python -m benchmarks.generate_ranks [examples/jelly3d.toml] [--contacts 8] [--out DIR]

The states are made first and not counted. Then one rank solves so many contacts, two ranks twice as many, one rank
again: the ratio is taken against the mean of the two single runs, so that a drift of the machine's speed cancels.
Figures to reach: 1.8 times the throughput, under 1.5 GiB a rank at 60,000 tetrahedra.
"""

from __future__ import annotations

import argparse
import os
import re
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import NamedTuple

from softprint.runtime.cli.script import run_script
from softprint.runtime.scenes.speed import machine

SUMMARY = re.compile(r"this run: (\d+) contacts in ([\d.]+) s on (\d+) rank\(s\), at most (\d+) MiB a rank")
COST = re.compile(r"([\d.]+) core-seconds of solves a sample")


class Run(NamedTuple):
    """contacts solved, seconds, MiB of the largest rank, core-seconds a sample of all so far."""

    contacts: int
    seconds: float
    memory: int
    cost: float

    @property
    def rate(self) -> float:
        """Contacts a second."""
        return self.contacts / self.seconds


def generate(experiment: Path, out: Path, ranks: int, contacts: int) -> Run:
    """So many more contacts in the run directory."""
    environment = {
        **os.environ,
        "OMP_NUM_THREADS": "1",
        "OPENBLAS_NUM_THREADS": "1",
        "OMPI_ALLOW_RUN_AS_ROOT": "1",
        "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM": "1",
    }
    command = [
        "mpirun",
        "-n",
        str(ranks),
        sys.executable,
        "-m",
        "softprint.runtime.cli.main",
        "generate",
        str(experiment),
    ]
    done = subprocess.run(
        [*command, "--out", str(out), "--units", str(contacts), "--quiet"],
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )
    summary, cost = SUMMARY.search(done.stdout), COST.search(done.stdout)
    if done.returncode != 0 or summary is None or cost is None:
        raise SystemExit(f"generate failed:\n{done.stdout}\n{done.stderr}")
    return Run(int(summary[1]), float(summary[2]), int(summary[4]), float(cost[1]))


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("experiment", type=Path, nargs="?", default=Path("examples/jelly3d.toml"))
    parser.add_argument("--contacts", type=int, default=8, help="for each rank and run (default: 8)")
    parser.add_argument("--out", type=Path, help="run directory to go on in (default: a temporary one)")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as temporary:
        out = options.out or Path(temporary)
        generate(options.experiment, out, 2, 1)
        first = generate(options.experiment, out, 1, options.contacts)
        both = generate(options.experiment, out, 2, 2 * options.contacts)
        again = generate(options.experiment, out, 1, options.contacts)
    here = machine()
    alone = 2.0 / (1.0 / first.rate + 1.0 / again.rate)
    print(f"{options.experiment}: {here['processor']}, {here['cores']} cores")
    for name, run in (("1 rank", first), ("2 ranks", both), ("1 rank", again)):
        print(
            f"{name:<8} {run.contacts:>4} contacts {run.seconds:>8.1f} s {run.rate:>8.3f} /s {run.memory:>6} MiB a rank"
        )
    print(
        f"throughput of two ranks: {both.rate / alone:.2f} times that of one; {again.cost:.2f} core-seconds a sample"
    )


if __name__ == "__main__":
    run_script(main)
