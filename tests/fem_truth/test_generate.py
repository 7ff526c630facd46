"""`softprint generate`: the same truth on one rank and on two, after a kill, and after damage; refusals;
import orders.

An undisturbed run on one rank is the reference for all others: their truth files must have the same content.
"""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("dolfinx")

from softprint.runtime.mesh import box_mesh, write_mesh
from softprint.runtime.truth.truth_file import load_truth
from softprint.runtime.truth.truth_schema import CONVERGED
from tests.kill_generate import kill_storm

EXPERIMENT = """
[experiment]
name = "tiny"
seed = 3
[body]
mesh = "box.vtu"
handles = {points = 5, frames = [{name = "base", box = [[-1.0, -1.0], [1.0, 0.013]]}]}
material = {young = 2e4, poisson = 0.4, density = 1000.0}
[[colliders]]
name = "ball"
shape = "circle"
radius = 0.02
[contact]
stiffness = 1e10
[dynamics]
time_step = 0.02
gravity = [0.0, -9.81]
[sampling]
collider = "ball"
states = 2
places = 4
rotations = 3
depths = 3
max_depth = 0.005
repeat_share = 0.25
[[scenes]]
name = "press"
role = "record"
duration = 0.4
kinematic = ["base"]
[[scenes.colliders]]
name = "ball"
keyframes = [{time = 0.0, position = [0.0, 0.1]}, {time = 0.3, position = [0.01, 0.06]}]
"""
N_CONTACTS = 2 * 4 * 3
REPOSITORY = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="module")
def experiment(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("tiny")
    write_mesh(folder / "box.vtu", box_mesh((-0.05, 0.0), (0.05, 0.05), (12, 8)))
    (folder / "tiny.toml").write_text(EXPERIMENT)
    return folder / "tiny.toml"


GENERATE = ("-m", "softprint.runtime.cli.main", "generate")


def command(*arguments: str | Path, ranks: int = 1, program: Sequence[str] = GENERATE) -> list[str]:
    launcher = ["mpirun", "--oversubscribe", "-n", str(ranks)] if ranks > 1 else []
    return [*launcher, sys.executable, *program, *map(str, arguments)]


def environment() -> dict[str, str]:
    return {
        **os.environ,
        "PYTHONPATH": str(REPOSITORY),
        "OMPI_ALLOW_RUN_AS_ROOT": "1",
        "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM": "1",
    }


def generate(
    *arguments: str | Path, ranks: int = 1, program: Sequence[str] = GENERATE
) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        command(*arguments, ranks=ranks, program=program),
        env=environment(),
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )


def content(out: Path) -> str:
    with load_truth(out / "truth.h5") as truth:
        assert truth.complete
        return truth.content_hash


@pytest.fixture(scope="module")
def reference(experiment: Path) -> Path:
    """The run directory of an undisturbed run on one rank."""
    out = experiment.parent / "reference"
    finished = generate(experiment, "--out", out)
    assert finished.returncode == 0, finished.stderr
    assert f"{N_CONTACTS} of {N_CONTACTS} contacts" in finished.stdout
    return out


def test_the_truth_is_complete_and_satisfies_its_constraint(reference: Path) -> None:
    from softprint.runtime.body import load_body

    body = load_body(reference / "body.h5")
    with load_truth(reference / "truth.h5", body) as truth:
        assert truth.n_samples == 3 * N_CONTACTS
        assert len(truth.states) == 2
        assert np.all(truth.samples["status"] == CONVERGED)
        assert np.all(truth.samples["residual"] <= 3e-4)  # the default of [sampling.solver]
        assert np.all(truth.samples["decrement"] <= 1e-4)
        assert len(truth.repeat) == 3 * N_CONTACTS // 4
        # The solver's decrement of 1e-4 allows about 1 % of error to each of the two.
        assert truth.noise_floor < 0.02
        for sample in (0, 10, 50):
            u, state = truth.displacement(sample).astype(float), truth.sample_state[sample]
            # U^T (x - U q) = 0 for the equilibria with and without contact; 1e-6 is what float32 keeps.
            assert (
                np.abs(body.constraint_basis.T @ u).max()
                < 1e-6 * np.abs(u).max() * np.abs(body.basis).sum(axis=0).max()
            )
            internal = body.reduced_positions(truth.states["rows"][state]) + truth.internal(state)
            depth = _depth_of_circle(truth.pose(sample).apply_inverse(internal[body.mesh.facets]))
            # Measured at points on the facets, none farther than s = 0.33 mm from the deepest: short by s^2 / (2 r).
            assert -1e-12 <= depth - truth.samples["depth"][sample] <= 2.8e-6
    assert not (reference / "shards").exists()


def test_without_rotations_the_collider_keeps_its_orientation(experiment: Path, tmp_path: Path) -> None:
    """One contact at each place, instead of one for each rotation."""
    finished = generate(experiment, "--out", tmp_path, "--set", "sampling.rotations=0")
    assert finished.returncode == 0, finished.stderr
    with load_truth(tmp_path / "truth.h5") as truth:
        assert len(truth.contacts) == N_CONTACTS // 3
        np.testing.assert_array_equal(
            truth.contacts["rotation"], np.broadcast_to(np.eye(2), (N_CONTACTS // 3, 2, 2))
        )


def test_the_approach_path_of_a_sample_leads_in_from_outside(reference: Path) -> None:
    """A straight line, deeper with every step, no step longer than an eighth of the contact's largest depth."""
    from softprint.runtime.body import load_body

    body = load_body(reference / "body.h5")
    with load_truth(reference / "truth.h5", body) as truth:
        for sample in (0, 10, 50):
            contact, state = truth.samples["contact"][sample], truth.sample_state[sample]
            deepest = truth.samples["depth"][truth.samples["contact"] == contact].max()
            internal = body.reduced_positions(truth.states["rows"][state]) + truth.internal(state)
            path = truth.approach_path(sample)
            assert len(path) == np.ceil(8 * truth.samples["depth"][sample] / deepest)
            np.testing.assert_array_equal(path[-1].translation, truth.pose(sample).translation)
            depths = [_depth_of_circle(pose.apply_inverse(internal[body.mesh.facets])) for pose in path]
            # Between samples, depth is assumed to grow evenly along the path.
            assert np.diff([0.0, *depths]).min() > 0.0
            assert np.diff([0.0, *depths]).max() < 1.5 * deepest / 8
            steps = np.diff([pose.translation for pose in path], axis=0)
            direction = truth.contacts["direction"][contact]
            np.testing.assert_allclose(steps, np.outer(steps @ direction, direction), atol=1e-15)
        # The circle is thicker than any sample is deep.
        assert (truth.contacts["thickness"] == np.inf).all()
        assert not truth.deep_in_thin.any()


def _depth_of_circle(facets: np.ndarray) -> float:
    """How deep the circle about the origin is below the nearest of the facets (n, 2, 2)."""
    start, along = facets[:, 0], facets[:, 1] - facets[:, 0]
    share = -(start * along).sum(axis=1) / np.square(along).sum(axis=1)
    nearest = start + np.clip(share, 0.0, 1.0)[:, None] * along
    return float(0.02 - np.linalg.norm(nearest, axis=1).min())


@pytest.fixture(scope="module")
def duration(experiment: Path, reference: Path) -> float:
    """Duration of an undisturbed run on two ranks [s]."""
    out = experiment.parent / "two_ranks"
    began = time.monotonic()
    finished = generate(experiment, "--out", out, ranks=2)
    assert finished.returncode == 0, finished.stderr
    assert content(out) == content(reference)
    return time.monotonic() - began


def test_two_ranks_give_the_same_truth(duration: float) -> None:
    assert duration > 0


def test_two_ranks_that_solve_together_give_the_same_truth(experiment: Path, reference: Path) -> None:
    out = experiment.parent / "together"
    finished = generate(experiment, "--out", out, "--ranks-per-solve", "2", "--units", "4", ranks=2)
    assert finished.returncode == 0, finished.stderr
    assert "2 rank(s), 2 to a solve" in finished.stdout
    farmed = experiment.parent / "two_groups"
    assert (
        generate(experiment, "--out", farmed, "--ranks-per-solve", "2", "--units", "4", ranks=4).returncode
        == 0
    )
    with load_truth(out / "truth.h5") as one, load_truth(farmed / "truth.h5") as two:
        assert one.content_hash == two.content_hash  # to the last bit, whichever group solves a contact
    with load_truth(out / "truth.h5") as split, load_truth(reference / "truth.h5") as whole:
        assert split.n_samples == 3 * 4
        assert len(split.repeat) == 3
        for sample in range(split.n_samples):
            assert split.samples["status"][sample] == whole.samples["status"][sample]
            u, v = split.displacement(sample), whole.displacement(sample)
            # Both stop within the solver's tolerance of the same point: 1e-4 in the decrement, 1 % of displacement.
            assert np.linalg.norm(u - v) < 0.01 * np.linalg.norm(v)


def test_incomplete_groups_of_ranks_are_refused(experiment: Path) -> None:
    out = experiment.parent / "left_over"
    refused = generate(experiment, "--out", out, "--ranks-per-solve", "3", ranks=2)
    assert refused.returncode == 1
    assert "--ranks-per-solve 3: 2 rank(s) do not divide into groups" in refused.stderr
    assert "Traceback" not in refused.stderr
    refused = generate(experiment, "--out", out, "--ranks-per-solve", "0")
    assert refused.returncode == 1
    assert "must be at least 1" in refused.stderr


@pytest.mark.slow
def test_six_kills_lose_nothing(experiment: Path, reference: Path, duration: float) -> None:
    """Kills all processes, one rank, or mpirun, twice each, at times drawn from the duration of an undisturbed run, one
    of them while a file is written. (`python -m tests.kill_generate` kills as often as one likes.)"""
    storm = kill_storm(experiment, experiment.parent, 6, seed=4, wanted=content(reference), duration=duration)
    assert storm.is_harmless, str(storm)
    assert storm.kills.total() == 6
    assert set(storm.kills.values()) == {2}
    assert storm.truths >= 1
    assert storm.kept > 0, "no kill came after a contact was finished"


def test_a_full_disk_is_reported_and_the_run_resumes_with_space(experiment: Path, reference: Path) -> None:
    """File sizes are limited, which is like a full disk for HDF5: first below the size of the body file, then below
    that of the truth file, which is larger than any shard."""
    out = experiment.parent / "full"
    limited = (  # MPI first, because it needs large files itself
        "import resource, sys; from mpi4py import MPI; limit = int(sys.argv.pop(1))\n"
        "resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))\n"
        "from softprint.runtime.cli.main import main; sys.exit(main())"
    )
    body, truth = ((reference / name).stat().st_size for name in ("body.h5", "truth.h5"))
    for name, limit in (("body.h5", body // 2), ("truth.h5", truth - 5000)):
        full = subprocess.run(
            [sys.executable, "-c", limited, str(limit), "generate", experiment, "--out", out, "--quiet"],
            env=environment(),
            capture_output=True,
            text=True,
            timeout=120,
            check=False,
        )
        assert full.returncode == 1, full.stderr
        assert full.stderr.splitlines()[-1] == f"cannot write {out / name}: File too large"
        assert "Traceback" not in full.stderr
        assert not [
            path for path in out.rglob("*") if path.name == name or path.name.startswith(f".{name[:-3]}.")
        ]
    assert len(finished_contacts(out)) == N_CONTACTS
    done = generate(experiment, "--out", out)
    assert "this run: 0 contacts" in done.stdout
    assert content(out) == content(reference)


def test_ctrl_c_on_two_ranks_keeps_what_is_finished(experiment: Path) -> None:
    out = experiment.parent / "interrupted"
    # mpirun may take more than a second to pass Ctrl-C on: there must be work for longer than that.
    more = ("--set", "sampling.places=8", "--set", "sampling.rotations=30")
    process = subprocess.Popen(
        command(experiment, "--out", out, *more, ranks=2),
        env=environment(),
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,  # Open MPI 4 forwards the output of ranks after Ctrl-C, Open MPI 5 does not
        start_new_session=True,
    )
    wait_for_shards(out, process)
    os.killpg(process.pid, signal.SIGINT)  # as a terminal does: to mpirun and its process group
    assert process.wait(timeout=60) != 0
    done = finished_contacts(out)
    assert 3 <= len(done) < 2 * 8 * 30
    assert not (out / "truth.h5").exists()
    assert generate(experiment, "--out", out, *more, "--units", "1", ranks=2).returncode == 0
    assert {path: path.stat().st_mtime_ns for path in done} == done  # nothing finished was computed again
    with load_truth(out / "truth.h5") as truth:
        assert len(truth.contacts) == len(done) + 1


def wait_for_shards(out: Path, process: subprocess.Popen) -> None:
    """Wait until three contacts are finished and more are in progress."""
    patience = time.monotonic() + 60
    while len(finished_contacts(out)) < 3:
        assert process.poll() is None
        assert time.monotonic() < patience
        time.sleep(0.002)


def finished_contacts(out: Path) -> dict[Path, int]:
    """Shards of finished contacts, and their modification times [ns]."""
    return {path: path.stat().st_mtime_ns for path in out.glob("shards/contact_*.shard")}


def test_a_part_is_useful_and_damaged_shards_are_made_again(experiment: Path, reference: Path) -> None:
    out = experiment.parent / "parts"
    finished = generate(experiment, "--out", out, "--units", "8")
    assert finished.returncode == 0, finished.stderr
    assert f"8 of {N_CONTACTS} contacts (partial" in finished.stdout
    with load_truth(out / "truth.h5") as truth:
        assert not truth.complete
        assert set(truth.contacts["state"]) == {0, 1}  # 2 states x 4 places of its own
        assert len(set(truth.contacts["place"])) == 8
    shards = sorted(out.glob("shards/contact_*.shard"))
    shards[0].write_bytes(shards[0].read_bytes()[:-100])
    altered = bytearray(shards[1].read_bytes())
    altered[-50] ^= 1
    shards[1].write_bytes(altered)
    shards[2].write_bytes(b"")
    # A run that does not come to them leaves them out.
    assert generate(experiment, "--out", out, "--units", "0").returncode == 0
    with load_truth(out / "truth.h5") as truth:
        assert len(truth.contacts) == 8 - 3
    assert generate(experiment, "--out", out).returncode == 0
    assert content(out) == content(reference)


def test_a_depth_beyond_the_body_is_refused(experiment: Path) -> None:
    """5.5 for 5.5 mm."""
    refused = generate(experiment, "--out", experiment.parent / "deep", "--set", "sampling.max_depth=5.5")
    assert refused.returncode == 1
    assert "sampling.max_depth = 5.5 m is more than the body is large, 0.1 m; lengths are in metres" in refused.stderr


def test_a_changed_experiment_is_refused_until_restarted(experiment: Path) -> None:
    out = experiment.parent / "changed"
    assert generate(experiment, "--out", out, "--units", "2").returncode == 0
    refused = generate(experiment, "--out", out, "--set", "sampling.max_depth=0.004")
    assert refused.returncode == 1
    assert "sampling.max_depth: 0.005 -> 0.004" in refused.stderr
    assert "Traceback" not in refused.stderr
    anew = generate(
        experiment, "--out", out, "--set", "sampling.max_depth=0.004", "--units", "2", "--no-resume"
    )
    assert anew.returncode == 0, anew.stderr
    with load_truth(out / "truth.h5") as truth:
        assert len(truth.contacts) == 2
        assert truth.samples["depth"].max() <= 0.004


def test_a_new_start_that_was_stopped_goes_on(experiment: Path, reference: Path) -> None:
    """The finished truth stays until the new one replaces it, and is not taken for that."""
    out = experiment.parent / "anew"
    shutil.copytree(reference, out)
    before = (out / "truth.h5").stat().st_mtime_ns
    run = subprocess.Popen(command(experiment, "--out", out, "--no-resume"), env=environment())
    while not any((out / "shards").glob("contact_*.shard")):
        assert run.poll() is None
        time.sleep(0.01)
    run.kill()
    run.wait()
    assert (out / "truth.h5").stat().st_mtime_ns == before
    finished = generate(experiment, "--out", out)
    assert finished.returncode == 0, finished.stderr
    assert "this run: 0 contacts" not in finished.stdout
    assert (out / "truth.h5").stat().st_mtime_ns > before
    assert content(out) == content(reference)
    assert not (out / "shards").exists()


def test_a_finished_truth_is_not_computed_again(experiment: Path, reference: Path) -> None:
    before = (reference / "truth.h5").stat().st_mtime_ns
    finished = generate(experiment, "--out", reference)
    assert "this run: 0 contacts" in finished.stdout
    assert (reference / "truth.h5").stat().st_mtime_ns == before


def test_an_experiment_without_recordings_is_refused_on_all_ranks(experiment: Path) -> None:
    bare = experiment.parent / "bare.toml"
    bare.write_text(EXPERIMENT[: EXPERIMENT.index("[[scenes]]")])
    refused = generate(bare, "--out", experiment.parent / "bare", ranks=2)
    assert refused.returncode != 0
    assert 'no scene has role = "record"' in refused.stderr
    assert "Traceback" not in refused.stderr


@pytest.mark.parametrize("order", [("h5py", "dolfinx"), ("dolfinx", "h5py")], ids="-".join)
def test_h5py_and_dolfinx_live_together_in_both_orders(tmp_path: Path, order: tuple[str, str]) -> None:
    script = (
        f"import {order[0]}\nimport {order[1]}\n"
        "from mpi4py import MPI\n"
        "dolfinx.mesh.create_unit_square(MPI.COMM_SELF, 2, 2)\n"
        f"file = h5py.File({str(tmp_path / 'x.h5')!r}, 'w')\n"
        "file['x'] = [1.0, 2.0]\nfile.attrs['text'] = 'ok'\nfile.close()\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", script], env=environment(), capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr


WITHOUT_COLLIDERS = (
    EXPERIMENT[: EXPERIMENT.index("[[colliders]]")]
    + """
[dynamics]
time_step = 0.02
gravity = [0.0, 0.0]
[sampling]
states = 5
record_with = "RECORD"
disturbed = 1
disturbance = 0.01
[[scenes]]
name = "shear"
role = "record"
duration = 0.4
[[scenes.kinematic]]
handle = "base"
keyframes = [{time = 0.0, position = [0.0, 0.0]}, {time = 0.3, position = [0.01, 0.0], rotation = 0.3}]
[[scenes.kinematic]]
handle = 0
keyframes = [{time = 0.0, position = [0.0, 0.0]}, {time = 0.3, position = [0.01, 0.01]}]
"""
)


@pytest.mark.parametrize("record", ["condensed", "full", "forces"])
def test_without_colliders_the_truth_is_of_states_alone(experiment, record, tmp_path):
    """Each state is followed by its disturbed one, which is near it but another one."""
    path = experiment.parent / f"states_{record}.toml"
    path.write_text(WITHOUT_COLLIDERS.replace("RECORD", record))
    out = tmp_path / "states"
    finished = generate(path, "--out", out, ranks=2)
    assert finished.returncode == 0, finished.stderr
    assert "5 states without contact" in finished.stdout
    with load_truth(out / "truth.h5") as truth:
        assert truth.complete
        assert (len(truth.contacts), len(truth.samples), truth.header.colliders) == (0, 0, ())
        rows, frame = truth.states["rows"], truth.states["frame"]
        assert truth.states["stable"].all()
        others = np.flatnonzero(frame[1:] == frame[:-1])
        assert len(others) >= 1
        moved = np.abs(rows[others + 1] - rows[others]).max(axis=(1, 2))
        assert (moved > 1e-4).all()  # m, of 0.1 m
        assert (moved < 0.02).all()
    before = content(out)
    again = generate(path, "--out", out)
    assert again.returncode == 0, again.stderr
    assert content(out) == before


# `softprint generate`, in which rank 1 is slow to read each shard.
SLOW_READER = """
import sys, time
import h5py
from mpi4py import MPI
from softprint.fem_truth.generate import state_stage
from softprint.runtime.cli.main import main

read_shard = state_stage.read_shard

def read_slowly(path):
    time.sleep(0.1 * MPI.COMM_WORLD.rank)
    return read_shard(path)

state_stage.read_shard = read_slowly
sys.exit(main(["generate", *sys.argv[1:]]))
"""


def test_shards_are_kept_until_every_rank_has_read_them(experiment, tmp_path):
    """Without colliders nothing but reading the states comes before the truth file is written and shards removed."""
    path = experiment.parent / "states_slow.toml"
    path.write_text(WITHOUT_COLLIDERS.replace("RECORD", "forces"))
    finished = generate(path, "--out", tmp_path / "states", ranks=2, program=("-c", SLOW_READER))
    assert finished.returncode == 0, finished.stderr
    assert "5 states without contact" in finished.stdout
