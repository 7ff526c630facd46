"""From a mesh file to a body's mesh and an experiment file: the implementation of `softprint new`."""

from __future__ import annotations

import os
import re
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from softprint.runtime.arrays import Array
from softprint.runtime.authoring.body_source import MadeBody, Placing, Stage, made_body
from softprint.runtime.authoring.choose_settings import Settings, choose_settings
from softprint.runtime.authoring.experiment_text import RECORD, TEST, Contents, Sampling, experiment_text
from softprint.runtime.authoring.probe_scenes import Probe, probe_scenes
from softprint.runtime.colliders.library import library_collider
from softprint.runtime.colliders.sampled.polygon import polygon_collider
from softprint.runtime.errors import SoftprintError
from softprint.runtime.experiment import Experiment, load_experiment
from softprint.runtime.io.files import atomic_path
from softprint.runtime.mesh import Mesh, read_mesh, write_mesh

# Of the library: eight shapes to learn from, of all its families, two to choose by, and two to judge by.
TRAINING = ("ball", "egg", "cushion", "slab", "gear_12", "boulder", "spring", "snake")
CHOOSING = ("caltrop", "pear")
JUDGING = ("torus", "coral")
# Colliders of the scenes: states are recorded with shapes that are learned from, models compared with others.
RECORDED = ("ball", "caltrop", "cushion", "pear", "egg", "boulder")
FLAT_RECORDED, FLAT_TEST = 5, 2  # scenes in the plane, all with the star
_STAR = 5  # points of the star
SPACE = Sampling(states=5, places=4, rotations=12, test_places=2)
PLANE = Sampling(states=5, places=16, rotations=8)
_RESOLUTION = 24  # of colliders while scenes are made: right within some hundredths of their size


@dataclass(frozen=True, eq=False)
class Wanted:
    """What is asked for. mesh: the file; out: the experiment file; cells; placing; hold: a side, a box, or what chooses
    a box for the body; young [Pa], chosen if None; seed; force: overwrite; sampling: chosen if None."""

    mesh: Path
    out: Path
    cells: int
    placing: Placing
    hold: str | Array | Callable[[Mesh], Array]
    young: float | None = None
    seed: int = 7
    force: bool = False
    sampling: Sampling | None = None


@dataclass(frozen=True, eq=False)
class New:
    """The two files, and what they hold."""

    experiment: Path
    mesh: Path
    body: MadeBody
    settings: Settings


def new_experiment(wanted: Wanted, stage: Stage) -> New:
    """Write `NAME.vtu` and `NAME.toml`, both or neither. Raises SoftprintError with one sentence if no body can be
    made, or if a file would be overwritten."""
    out, name = wanted.out, experiment_name(wanted.out)
    mesh_file = _mesh_file(wanted)
    for path in (out, mesh_file):
        if path.exists() and not wanted.force:
            raise SoftprintError(f"{path} exists: --force overwrites it, --out NAME.toml names another")
    made = made_body(wanted.mesh, wanted.placing, wanted.cells, stage)
    with tempfile.TemporaryDirectory(prefix="softprint-new-") as folder:
        draft = Path(folder) / mesh_file.name
        write_mesh(draft, made.mesh)
        mesh = read_mesh(draft)  # as everything else will read it: rounded
        hold = wanted.hold(mesh) if callable(wanted.hold) else wanted.hold
        with stage("choosing settings"):
            settings = choose_settings(mesh, hold, wanted.young)
        with stage("making scenes"):
            probes, outline = _probes(mesh, settings, np.random.default_rng(wanted.seed))
        text = experiment_text(
            Contents(
                name=name,
                mesh=mesh_file.name,
                made=made.said,
                cells=mesh.n_cells,
                size=np.ptp(mesh.points, axis=0),
                apart=made.apart,
                settings=settings,
                sampling=wanted.sampling or (SPACE if mesh.dim == 3 else PLANE),
                seed=wanted.seed,
                shapes=(*TRAINING, *CHOOSING, *JUDGING) if mesh.dim == 3 else (),
                outline=outline,
                probes=probes,
            )
        )
        checked = Path(folder) / out.name
        checked.write_text(text, encoding="utf-8")
        _check(load_experiment(checked))
        with atomic_path(mesh_file) as whole:
            whole.write_bytes(draft.read_bytes())
        with atomic_path(out) as whole:
            whole.write_text(text, encoding="utf-8")
    return New(out, mesh_file, made, settings)


def experiment_name(out: Path) -> str:
    """The name of the experiment of that file. Raises SoftprintError if the file's name has no letter or digit, or is
    no TOML file's."""
    if out.suffix.lower() != ".toml":
        raise SoftprintError(f"--out {out}: an experiment file is TOML; call it {out.stem or 'body'}.toml")
    name = re.sub(r"[^A-Za-z0-9_.-]+", "_", out.stem).strip("_.-")[:80]
    if not name:
        raise SoftprintError(f"--out {out}: needs a name of letters and digits, such as body.toml")
    return name


def _mesh_file(wanted: Wanted) -> Path:
    """NAME.vtu beside the experiment file; NAME_body.vtu if that is the file given."""
    path = wanted.out.with_suffix(".vtu")
    same = path.exists() and wanted.mesh.exists() and os.path.samefile(path, wanted.mesh)
    return path.with_name(f"{path.stem}_body.vtu") if same else path


def _probes(
    mesh: Mesh, settings: Settings, rng: np.random.Generator
) -> tuple[list[tuple[str, str, Probe]], Array | None]:
    """The scenes by name and role, and the corners of the collider in the plane."""
    outline: Array | None = None
    if mesh.dim == 2:
        outline = star(settings.collider)
        shape = polygon_collider(outline, 0.15 * settings.collider, name="star")
        recorded, judged = ("star",) * FLAT_RECORDED, ("star",) * FLAT_TEST
        colliders = [(name, shape) for name in (*recorded, *judged)]
    else:
        recorded, judged = RECORDED, JUDGING
        colliders = [
            (name, library_collider(name, settings.collider, _RESOLUTION)) for name in (*recorded, *judged)
        ]
    probes = probe_scenes(mesh, settings, colliders, rng)
    roles = [RECORD] * len(recorded) + [TEST] * len(judged)
    numbers = [*range(1, len(recorded) + 1), *range(1, len(judged) + 1)]
    names = [
        f"{'probe' if role == RECORD else 'held_out'}_{n}" for role, n in zip(roles, numbers, strict=True)
    ]
    return list(zip(names, roles, probes, strict=True)), outline


def star(size: float) -> Array:
    """(10, 2) corners of a star about the origin, within `size` of it [m]."""
    angle = np.pi / 2 + np.pi * np.arange(2 * _STAR) / _STAR
    radius = size * np.where(np.arange(2 * _STAR) % 2, 0.45, 1.0)
    return radius[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])


def _check(experiment: Experiment) -> None:
    """Every frame and handle can be placed: what `softprint body` would refuse is refused here."""
    from softprint.runtime.body.placement import frames_of, place_handles

    mesh = read_mesh(experiment.base_dir / experiment.body.mesh)
    handles = experiment.body.handles
    place_handles(mesh, handles.points, frames_of(mesh, handles.frames))
