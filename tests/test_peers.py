"""`python -m benchmarks.peers`: one scene for all engines, measures that vanish for the reference, and each engine."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from benchmarks.peers import compare, mujoco_flex, newton_vbd, ours
from benchmarks.peers.__main__ import PEERS, main
from benchmarks.peers.engine import MissingEngine, Played, Setting, engine_module, play, relax, steps_of
from benchmarks.peers.scene import CLEAR, DEPTH, FRAME, RADIUS, Scene, ball
from softprint.runtime.errors import SoftprintError
from softprint.runtime.experiment import load_experiment

REPOSITORY = Path(__file__).resolve().parent.parent
FRAMES = 12  # of the scene: the ball is 2 mm deep by then


@pytest.fixture(scope="module")
def scene(jelly3d_body) -> Scene:
    """On a body of 600 tetrahedra."""
    return ball(load_experiment(REPOSITORY / "examples" / "jelly_library_small.toml"), jelly3d_body)


@pytest.fixture(scope="module")
def played(scene: Scene) -> Played:
    """The reference, pressed. With more points of contact: facets are 20 mm long, and the ball would pass between."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(ours, "REFERENCE_REFINEMENT", 10)
        engine = ours.reference(scene)
        engine.settle(scene.body.mesh.points)
        return play(engine, scene, engine.positions(), FRAMES)


def setting(engine: str = "bare", step: float = FRAME) -> Setting:
    return Setting(engine, "a law", "", step, 0, lambda scene: ours.full_space(scene, step))


def hung_off(engine: object, scene: Scene) -> float:
    """How far an engine hangs from full space under sideways gravity, relative to how far it moves."""
    points = scene.body.mesh.points
    full = ours.full_space(scene, FRAME)
    full.settle(points)
    relax(engine, engine.place, points, 40)
    return compare.rms(engine.positions() - full.positions()) / compare.rms(full.positions() - points)


@pytest.fixture
def sideways(scene: Scene) -> Scene:
    return scene.pulled(np.array([9.81, 0.0, 0.0]))


def test_the_ball_goes_in_and_comes_out(scene: Scene):
    top = scene.body.mesh.points[:, 2].max()
    heights = [scene.pose(frame * FRAME).translation[2] - RADIUS - top for frame in range(scene.n_frames + 1)]
    assert heights[0] == pytest.approx(CLEAR)
    assert min(heights) == pytest.approx(-DEPTH)
    assert heights[-1] > 0.0
    assert set(scene.held) | set(scene.free) == set(range(scene.body.n_nodes))
    assert (scene.body.mesh.points[scene.held, 2] < scene.body.mesh.points[scene.free, 2].min() + 1e-9).all()


def test_lame_parameters_are_those_of_young_and_poisson(scene: Scene):
    (young, poisson), (mu, lame) = scene.elastic, scene.lame
    assert mu == pytest.approx(young / (2.0 * (1.0 + poisson)))
    assert lame == pytest.approx(young * poisson / ((1.0 + poisson) * (1.0 - 2.0 * poisson)))


def test_the_depth_is_that_of_the_geometry(scene: Scene):
    """Of the undeformed body: as deep as the ball is, but for the distance of its lowest point from the points."""
    time = 0.425  # it is down
    depth = scene.depth(scene.body.mesh.points, time)
    assert 0.95 * DEPTH < depth <= DEPTH + 1e-12
    assert scene.pulled(scene.gravity).depth(scene.body.mesh.points, time) == 0.0


def test_the_reference_is_at_no_distance_from_itself(scene: Scene, played: Played):
    own = compare.row(scene, setting(), played, played)
    assert (own.off, own.force, own.ended) == (0.0, 0.0, "")
    assert own.bearing > 0.01
    assert own.depth < 3e-4  # a node is a millimetre from the next of the points


def test_a_lost_run_is_unstable_and_is_shown(scene: Scene, played: Played, tmp_path: Path):
    class Bursting(ours.SoftprintEngine):
        def positions(self):
            return super().positions() * (np.nan if self._state.time > 0.1 else 1.0)

    simulator = ours.full_space(scene, FRAME)._simulator
    lost = play(Bursting(scene, simulator, FRAME), scene, scene.body.mesh.points, FRAMES)
    assert lost.ended == "unstable at 0.12 s"
    assert len(lost.x) == 6
    rows = [
        compare.row(scene, setting("full space"), played, played),
        replace(compare.row(scene, setting(), played, played), off=1e-3),
        compare.row(scene, setting("MuJoCo flex"), lost, played),
    ]
    assert "unstable at 0.12 s |" in compare.table(rows).splitlines()[-1]
    compare.write(tmp_path / "rows.json", rows, {"machine": "this"})
    assert list(compare.read(tmp_path / "rows.json").values()) == rows
    assert json.loads((tmp_path / "rows.json").read_text())["machine"] == "this"
    compare.draw(rows, tmp_path / "plot.png")
    assert (tmp_path / "plot.png").stat().st_size > 1000


def test_a_missing_engine_is_told_with_what_brings_it():
    with pytest.raises(
        MissingEngine, match=r"no_such_engine is not installed .* pip install --no-deps this==1\.0"
    ):
        engine_module("no_such_engine", "this==1.0")


def test_versions_are_pinned_in_one_way():
    """In the modules, in constraints/peers.txt and in pyproject.toml."""
    pinned = {word for _, packages, _ in PEERS.values() for word in packages.split()}
    lines = (REPOSITORY / "constraints" / "peers.txt").read_text().splitlines()
    assert {line for line in lines if line and not line.startswith("#")} == pinned
    extra = next(
        line
        for line in (REPOSITORY / "pyproject.toml").read_text().splitlines()
        if line.startswith("peers = ")
    )
    assert set(extra.split('"')[1::2]) == pinned


def test_a_step_is_a_part_of_a_frame():
    assert steps_of(FRAME / 8.0) == 8
    for step in (0.002, 2.0 * FRAME):
        with pytest.raises(SoftprintError, match="no whole number of steps"):
            steps_of(step)


def test_settings_differ():
    found = [*mujoco_flex.settings(), *mujoco_flex.cell_settings()]
    found += [*newton_vbd.settings(), *ours.settings(None, Path("ours.safetensors"))]
    assert len({compare.key_of("ball", own) for own in found}) == len(found)


def test_help_says_what_is_measured(capsys: pytest.CaptureFixture[str]):
    with pytest.raises(SystemExit):
        main(["--help"])
    assert "CPU and wall seconds for a simulated second" in capsys.readouterr().out


def test_mujoco_hangs_like_full_space(sideways: Scene):
    """Its neo-Hookean law is not that of full space at large strain; its other law is farther off."""
    pytest.importorskip("mujoco")
    off = [
        hung_off(mujoco_flex.MujocoFlex(sideways, mujoco_flex.Options(FRAME, law)), sideways)
        for law in (1, 0)
    ]
    assert off[0] < 0.02
    assert off[0] < off[1] < 0.1


def test_mujoco_pushes_back_like_full_space(scene: Scene, played: Played):
    pytest.importorskip("mujoco")
    engine = mujoco_flex.MujocoFlex(scene, mujoco_flex.Options(FRAME / 4.0))
    own = compare.row(scene, setting(), play(engine, scene, played.x[0], FRAMES), played)
    assert own.force < 0.1 * own.bearing
    assert own.off < 2e-4


def test_cells_of_mujoco_sag_like_full_space(scene: Scene):
    """In the mean. Linear tetrahedra of 20 mm are stiffer than its cells of the same size."""
    pytest.importorskip("mujoco")
    points = scene.body.mesh.points
    pulled = scene.pulled(scene.gravity)
    full = ours.full_space(pulled, FRAME)
    full.settle(points)
    engine = mujoco_flex.MujocoCells(pulled, mujoco_flex.Options(FRAME, cells=(5, 5, 4)))
    engine.settle(points)
    sag, own = points[:, 2] - full.positions()[:, 2], points[:, 2] - engine.positions()[:, 2]
    assert 1.0 < own.mean() / sag.mean() < 1.6


@pytest.mark.slow
def test_newton_hangs_like_full_space(sideways: Scene):
    """Its kernels are compiled at the first run, for minutes."""
    pytest.importorskip("newton")
    engine = newton_vbd.NewtonVbd(sideways, newton_vbd.Options(FRAME / 10.0, 20))
    assert hung_off(engine, sideways) < 0.05
