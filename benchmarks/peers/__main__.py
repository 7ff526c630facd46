"""Other simulators of soft bodies beside ours: how far from converged full space, at which cost?

    pip install --no-deps -r constraints/peers.txt
    OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 python -m benchmarks.peers [EXPERIMENT] [--plot docs/peers.png]
    python -m benchmarks.peers --laws

The same tetrahedra, density, held nodes, collider and motion, without friction, in MuJoCo's flex, in Newton's vertex
block descent, in full space and in our reduced models, each with several step sizes and iterations, on one thread.
A ball of 18 mm radius is pressed 7 mm into the top, dragged 20 mm sideways and lifted.

    reference  full space with a step of 1/240 s, contact 100 times as stiff, and a smaller tolerance
    off        RMS distance of the surface nodes from it, over frames of 1/60 s in which it is in contact
    force off  RMS distance of the force on the collider, relative to the RMS of the reference's
    depth      how deep the body's surface is in the collider, at 16 points of every facet, without any contact law
    cost       CPU and wall seconds for a simulated second: stepping, and the positions of all nodes at every frame

A run in which a node is lost is `unstable`, with the errors until then. Each starts at its own rest under gravity.
Finished rows are kept in --out: a run that was stopped continues. --laws compares the elasticity alone: how far the
surface is from full space when the body hangs under gravity, downward and sideways, without a collider.
"""

from __future__ import annotations

import argparse
import logging
import os
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import torch

from benchmarks.peers import mujoco_flex, newton_vbd, ours
from benchmarks.peers.compare import Row, draw, key_of, read, rms, row, table, write
from benchmarks.peers.engine import MissingEngine, Setting, engine_module, play, relax
from benchmarks.peers.scene import FRAME, Scene, ball
from softprint.runtime.body import build_body, load_body
from softprint.runtime.cli.script import run_script
from softprint.runtime.experiment import load_experiment
from softprint.runtime.mechanics.body_mechanics import compute_mechanics
from softprint.runtime.mechanics.mechanics_file import load_mechanics, mechanics_path
from softprint.runtime.scenes.speed import machine

EXPERIMENT = Path("examples/jelly_library_small.toml")
CONTACT_NODES = 3000
THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS")
# Frames played untimed first, so that no compilation is timed; and those of the comparison of laws.
_WARMED, _HUNG = 20, 60
PEERS = {
    mujoco_flex.NAME: ("mujoco", mujoco_flex.PACKAGES, mujoco_flex.settings),
    mujoco_flex.CELLS: ("mujoco", mujoco_flex.PACKAGES, mujoco_flex.cell_settings),
    newton_vbd.NAME: ("newton", newton_vbd.PACKAGES, newton_vbd.settings),
}


def all_settings(experiment: Path, run: Path, scene: Scene) -> Iterator[Setting]:
    """The rows that can be made here; what is left out is said on standard error."""
    stored = mechanics_path(run, CONTACT_NODES)
    mechanics = (
        load_mechanics(stored, scene.body)
        if stored.is_file()
        else compute_mechanics(scene.body, CONTACT_NODES, True)
    )
    trained = run / "corrections" / "ours.safetensors"
    if not trained.is_file():
        _say(
            f"ours is left out: {trained} is made by `softprint generate {experiment}` and `softprint train`"
        )
    yield from ours.settings(mechanics, trained if trained.is_file() else None)
    for name, (module, packages, settings) in PEERS.items():
        try:
            engine_module(module, packages)
        except MissingEngine as error:
            _say(f"{name} is left out: {error}")
            continue
        yield from settings()


def measure(scene: Scene, settings: Sequence[Setting], out: Path, told: Mapping[str, object]) -> list[Row]:
    """The rows of one scene, each written as soon as it is there."""
    kept = read(out)
    missing = [own for own in settings if key_of(scene.name, own) not in kept]
    if not missing:
        return [kept[key_of(scene.name, own)] for own in settings]
    simulator = ours.reference(scene)
    simulator.settle(scene.body.mesh.points)
    rest = simulator.positions()
    reference = play(ours.reference(scene), scene, rest)
    warm: set[str] = set()
    for own in missing:
        if own.engine not in warm:
            play(own.make(scene), scene, rest, _WARMED)
            warm.add(own.engine)
        made = row(scene, own, play(own.make(scene), scene, rest), reference)
        kept[made.key] = made
        write(out, list(kept.values()), told)
        _say(
            f"{own.engine}, {own.note}, {1e3 * own.step:.2f} ms, {own.iterations or ''}: {1e3 * made.off:.3f} mm"
        )
    return [kept[key_of(scene.name, own)] for own in settings]


def laws(scene: Scene) -> Iterator[str]:
    """Lines of a table: elasticity alone."""
    flex, vbd = mujoco_flex.MujocoFlex, newton_vbd.NewtonVbd
    peers: list[tuple[str, str, Callable[[Scene], Any]]] = [
        (mujoco_flex.NAME, law, partial(flex, options=mujoco_flex.Options(FRAME, i)))
        for i, law in enumerate(mujoco_flex.LAWS)
    ]
    cells = mujoco_flex.Options(FRAME, contact="firm", cells=(12, 12, 8))
    peers.append((mujoco_flex.CELLS, mujoco_flex.OF_CELLS, lambda own: mujoco_flex.MujocoCells(own, cells)))
    steps, iterations = newton_vbd.EXAMPLES
    options = newton_vbd.Options(FRAME / steps, iterations)
    peers.append((newton_vbd.NAME, newton_vbd.LAW, lambda own: vbd(own, options)))
    surface, points = scene.body.mesh.surface_nodes, scene.body.mesh.points
    yield "| engine | law | gravity | full space moved, mm | off, mm | |\n| --- | --- | --- | --- | --- | --- |"
    for direction, gravity in (("down", scene.gravity), ("sideways", scene.gravity[[2, 1, 0]])):
        pulled = scene.pulled(gravity)
        full = ours.full_space(pulled, FRAME)
        full.settle(points)
        x = full.positions()
        moved = rms((x - points)[surface])
        for name, law, make in peers:
            try:
                engine = make(pulled)
            except MissingEngine as error:
                _say(f"{name} is left out: {error}")
                continue
            if isinstance(engine, mujoco_flex.MujocoCells):
                engine.settle(points)
            else:
                relax(engine, engine.place, points, _HUNG)
            off = rms((engine.positions() - x)[surface])
            yield f"| {name} | {law} | {direction} | {1e3 * moved:.3f} | {1e3 * off:.3f} | {off / moved:.1%} |"


def _say(text: str) -> None:
    print(text, file=sys.stderr, flush=True)


def main(words: Sequence[str] | None = None) -> None:
    """Prints a table in Markdown."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("experiment", type=Path, nargs="?", default=EXPERIMENT)
    parser.add_argument("--run", type=Path, help="the run directory; default: runs/NAME")
    parser.add_argument("--out", type=Path, metavar="FILE.json", help="default: RUN/peers.json")
    parser.add_argument("--engines", nargs="+", metavar="NAME", help="of the rows; default: all")
    parser.add_argument("--plot", type=Path, metavar="FILE.png")
    parser.add_argument("--laws", action="store_true", help="compare the elasticity alone")
    options = parser.parse_args(words)
    logging.getLogger("softprint").setLevel(logging.ERROR)  # the table has what did not complete
    if any(os.environ.get(name) != "1" for name in THREADS):
        _say(f"timings on one thread need {'=1 '.join(THREADS)}=1 in the environment")
    torch.set_num_threads(1)
    run = options.run or Path("runs") / options.experiment.stem
    experiment = load_experiment(options.experiment)
    stored = run / "body.h5"
    body = load_body(stored) if stored.is_file() else build_body(experiment.body, experiment.base_dir)
    scene = ball(experiment, body)
    if options.laws:
        for line in laws(scene):
            print(line, flush=True)
        return
    settings = list(all_settings(options.experiment, run, scene))
    if options.engines:
        settings = [own for own in settings if own.engine in options.engines]
    rows = measure(scene, settings, options.out or run / "peers.json", {"machine": machine()})
    print(table(rows))
    if options.plot:
        draw(rows, options.plot)


if __name__ == "__main__":
    run_script(main)
