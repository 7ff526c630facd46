"""How long does the first step take after installation? In fresh processes, with an empty cache of kernels and after
`softprint.warm_up()`.

    python -m benchmarks.first_step [examples/jelly3d_small.toml] [--out RUN] [--kept DIRECTORY] [--repeats 2]

The first test scene is played with a correction for any collider: a trained one if the run directory has it, otherwise
an untrained one of the same architecture. Seconds of wall time, in the order in which a process meets them:

    imports     everything that is imported before the model is there (numba, torch, the packages of Softprint)
    files       body, mechanics and correction are read, the simulator is made
    first step  the scene's first one, not in contact as a rule
    contact     the first step with contact
    surface     the positions of the surface for drawing, for the first time
    later       the slowest of the ten steps after that: what is still compiled late shows here

and how many kernels each process had to compile, a kernel counted once for every combination of argument types. The
caches are in temporary folders; with --kept the warmed one is kept there and used again. Figure to reach: the first
step with contact in less than 3 s after the warm-up.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from importlib import import_module
from pathlib import Path

WANTED = 3.0  # s, first step with contact after the warm-up
STAGES = ("imports", "files", "first step", "contact", "surface", "later")
_LATER = 10
_WARM_UP = "import softprint; softprint.warm_up()"
Times = dict[str, float]


def compiled_in(cache: Path) -> int:
    """How many machine codes numba has put into its cache."""
    return len(list(cache.rglob("*.nbc")))


def play(experiment_path: Path, out: Path | None, correction: Path) -> Times:
    """Of this process, which should be a fresh one: seconds of every stage, see above."""
    watch = [time.perf_counter()]

    def lap() -> float:
        watch.append(time.perf_counter())
        return watch[-1] - watch[-2]

    from softprint.runtime.cli.context import Context
    from softprint.runtime.cli.run_body import body_of_run
    from softprint.runtime.scenes.playing import model_of_file
    from softprint.runtime.scenes.scene import scene_steps

    import_module("softprint.runtime.learned.force.entry")  # torch and what else reading a correction imports
    times = {"imports": lap()}
    context = Context(experiment_path=experiment_path, out=out)
    experiment = context.experiment
    scene = experiment.scenes_of_role("test")[0]
    model = model_of_file(experiment, body_of_run(context), scene, correction)
    times["files"] = lap()
    state, in_contact = model.start().state, 0
    for step in range(scene_steps(experiment, scene)):
        result = model.step(state)
        state, seconds = result.state, lap()
        if step == 0:
            times["first step"] = seconds
        if in_contact:
            times["later"] = max(seconds, times.get("later", 0.0))
        elif result.penetration > 0:
            times["contact"] = seconds
            model.surface_positions(state)
            times["surface"] = lap()
        in_contact += result.penetration > 0 or in_contact > 0
        if in_contact > _LATER:
            break
    return times


def in_fresh_process(arguments: list[str], cache: Path) -> tuple[str, float, int]:
    """What a process with that cache of kernels printed, its seconds, and how many machine codes it added."""
    before, began = compiled_in(cache), time.perf_counter()
    done = subprocess.run(
        [sys.executable, *arguments],
        env={**os.environ, "NUMBA_CACHE_DIR": str(cache)},
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode != 0:
        raise SystemExit(f"{' '.join(arguments)} failed:\n{done.stderr}")
    return done.stdout, time.perf_counter() - began, compiled_in(cache) - before


def line(name: str, times: Times, compiled: int) -> str:
    """One row of the table."""
    cells = "".join(f"{times[stage]:>12.2f}" if stage in times else f"{'-':>12}" for stage in STAGES)
    return f"{name:<18}{cells}{compiled:>10}"


def main() -> None:
    """Prepare the files, play with both caches, print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("experiment", nargs="?", type=Path, default=Path("examples/jelly3d_small.toml"))
    parser.add_argument("--out", type=Path, help="run directory (default: runs/EXPERIMENT)")
    parser.add_argument("--kept", type=Path, help="folder of the warmed cache (default: a temporary one)")
    parser.add_argument("--repeats", type=int, default=2, help="processes with the warmed cache (default: 2)")
    parser.add_argument("--no-empty", action="store_true", help="leave out the process with an empty cache")
    parser.add_argument("--play", type=Path, metavar="CORRECTION", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.play:
        print(json.dumps(play(options.experiment, options.out, options.play)))
        return

    from benchmarks.bodies_speed import correction_file
    from softprint.runtime.cli.context import Context
    from softprint.runtime.cli.run_body import body_of_run
    from softprint.runtime.scenes.speed import machine

    context = Context(experiment_path=options.experiment, out=options.out, quiet=True)
    body = body_of_run(context)
    correction, trained = correction_file(context, body, None)
    here = machine()
    print(f"{here['processor']}, {here['cores']} cores, threads {here['threads'] or 'not limited'}")
    print(
        f"{body.name}: {body.mesh.n_cells} cells, {body.n_rows} rows, {len(body.surface.nodes)} surface samples, "
        f"correction {'trained' if trained else 'untrained'}"
    )
    player = ["-m", "benchmarks.first_step", str(options.experiment), "--play", str(correction)]
    player += ["--out", str(context.out_dir)]
    with tempfile.TemporaryDirectory() as folder:
        empty, warmed = Path(folder) / "empty", options.kept or Path(folder) / "warmed"
        _, seconds, compiled = in_fresh_process(["-c", _WARM_UP], warmed)
        print(f"softprint.warm_up(): {seconds:.1f} s, {compiled} kernels compiled")
        print(f"{'seconds':<18}{''.join(f'{stage:>12}' for stage in STAGES)}{'compiled':>10}", flush=True)
        if not options.no_empty:
            told, _, compiled = in_fresh_process(player, empty)
            print(line("empty cache", json.loads(told), compiled), flush=True)
        slowest = 0.0
        for _ in range(options.repeats):
            told, _, compiled = in_fresh_process(player, warmed)
            times: Times = json.loads(told)
            slowest = max(slowest, times["contact"])
            print(line("after the warm-up", times, compiled), flush=True)
    print(f"first step with contact after the warm-up: {slowest:.2f} s at most (wanted: below {WANTED:g} s)")


if __name__ == "__main__":
    main()
