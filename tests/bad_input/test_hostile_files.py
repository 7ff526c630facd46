"""Hostile and broken files are refused with a clear message, or read: no crash, no traceback, no hang, no excessive
memory. No reader of ours runs code from a file."""

from __future__ import annotations

import ast
import json
import subprocess
import sys
from collections.abc import Iterable
from pathlib import Path

import pytest
import torch

from softprint.surrogate.checkpoints import Checkpoint, save_checkpoint
from tests.bad_input import hostile_data, hostile_drawings, hostile_meshes
from tests.bad_input.hostile_meshes import Variant

REPOSITORY = Path(__file__).resolve().parents[2]
MEMORY = 1000  # MiB: a process that has loaded all readers holds 300; a file of a MB may take 400 more
PATIENCE = 600.0  # s for a process, on a busy machine; each file has its own limit of processor time


def verdicts(variants: Iterable[Variant], folder: Path) -> list[tuple[str, str, str]]:
    """The outcome of each file: its name, "read", "refused", "bug" or "crash", and the message."""
    names, files = [], []
    for number, (name, kind, suffix, content) in enumerate(variants):
        path = folder / f"{number:04d}{suffix}"
        path.write_bytes(content)
        names.append(name)
        files.append((kind, str(path)))
    (folder / "list.json").write_text(json.dumps(files))
    found: list[tuple[str, str, str]] = []
    while len(found) < len(files):  # another process after each crash
        done = subprocess.run(
            [sys.executable, "-m", "tests.bad_input.hostile_reader", folder / "list.json", str(len(found))],
            cwd=REPOSITORY,
            capture_output=True,
            text=True,
            timeout=PATIENCE,
            check=False,
        )
        for line in done.stdout.splitlines():
            number, outcome, said, peak, _ = json.loads(line)
            assert peak < MEMORY, names[number]
            found.append((names[number], outcome, said))
        if len(found) < len(files):
            said = f"status {done.returncode}: {done.stderr[-500:]}"
            found.append((names[len(found)], "crash", said))
    return found


def check(variants: list[Variant], folder: Path, least: int) -> None:
    assert len(variants) >= least
    found = verdicts(variants, folder)
    for name, outcome, said in found:
        assert outcome in ("read", "refused"), f"{name}: {outcome}: {said}"
        if outcome == "refused":
            assert len(said.splitlines()) == 1, f"{name}: {said}"
    # Some changes are harmless, most are not.
    assert 0.5 * len(found) < sum(outcome == "refused" for _, outcome, _ in found) < len(found)


def test_geometry(tmp_path: Path) -> None:
    check([variant for kind in hostile_meshes.GEOMETRY for variant in kind()], tmp_path, least=300)


def test_scenes_and_drawings(tmp_path: Path) -> None:
    check([variant for kind in hostile_drawings.DRAWINGS for variant in kind()], tmp_path, least=120)


def test_files_of_our_own_kinds(finished_run: Path, tmp_path: Path) -> None:
    run, scratch = finished_run / "run", tmp_path / "scratch"
    checkpoint = tmp_path / "good.checkpoint"
    tensors = {"model.w": torch.arange(3.0), "adam.0.step": torch.tensor(3.0)}
    save_checkpoint(checkpoint, Checkpoint("run", 3, [{"step": 3.0}], tensors))
    variants = [
        *hostile_data.hdf5("body", run / "body.h5", scratch, 1),
        *hostile_data.hdf5("truth", run / "truth.h5", scratch, 2),
        *hostile_data.hdf5("motion", run / "motions" / "held_out_full.h5", scratch, 3),
        *hostile_data.tensors("correction", run / "corrections" / "ours.safetensors", scratch, 4),
        *hostile_data.tensors("checkpoint", checkpoint, scratch, 5),
        *hostile_data.tensors("mechanics", run / "mechanics_3000.safetensors", scratch, 6),
    ]
    check(variants, tmp_path, least=300)


# Runs the notebooks of the examples, as Jupyter would.
RUNS_NOTEBOOKS = REPOSITORY / "tests" / "notebook.py"
RUNS_CODE = {"pickle", "cPickle", "dill", "cloudpickle", "joblib", "shelve", "marshal"}


@pytest.mark.parametrize(
    "folder",
    [
        "runtime",
        "surrogate",
        "fem_truth",
        "meshes",
        "benchmarks",
        "reproduction",
        "tools",
        "examples",
        "tests",
    ],
)
def test_no_pickle(folder: str) -> None:
    """Neither directly nor by numpy, PyTorch or pandas; no `eval` or `exec` either."""
    for path in sorted((REPOSITORY / folder).rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text())):
            where = f"{path.relative_to(REPOSITORY)}:{getattr(node, 'lineno', 0)}"
            if isinstance(node, ast.Import):
                assert not {alias.name.partition(".")[0] for alias in node.names} & RUNS_CODE, where
            elif isinstance(node, ast.ImportFrom):
                assert (node.module or "").partition(".")[0] not in RUNS_CODE, where
            elif isinstance(node, ast.Call):
                options = {option.arg: ast.unparse(option.value) for option in node.keywords}
                called = ast.unparse(node.func)
                assert called not in ("eval", "exec") or path == RUNS_NOTEBOOKS, where
                assert called not in ("torch.load", "torch.save", "pd.read_pickle"), where
                assert options.get("allow_pickle", "False") == "False", where
                if called in ("np.load", "numpy.load"):
                    assert "allow_pickle" in options, where
