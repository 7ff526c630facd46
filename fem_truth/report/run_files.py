"""What a run directory holds of one experiment, and which verb makes what is missing."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from runtime.body.body import ReducedBody
from runtime.errors import SoftprintError
from runtime.experiment import Experiment, SceneSpec
from runtime.scenes.motion_file import Motion, load_motion
from runtime.scenes.simulate import inputs_hash, motion_path

FULL, BARE = "full", "bare"


@dataclass(frozen=True)
class RunFiles:
    """Paths of the files that are there; corrections by name, in alphabetical order."""

    folder: Path
    body: Path
    truth: Path | None
    corrections: dict[str, Path]

    @property
    def models(self) -> list[str]:
        """The models that can have simulated a scene."""
        return [FULL, BARE, *self.corrections]


def judged_scenes(experiment: Experiment) -> list[SceneSpec]:
    """The test scenes that a report is about: those with one collider, which is led, as full space has to play them and
    contact is compared under one."""
    return [scene for scene in experiment.scenes_of_role("test") if _can_be_judged(scene)]


def _can_be_judged(scene: SceneSpec) -> bool:
    return len(scene.colliders) == 1 and not scene.colliders[0].free


def find_run_files(folder: Path, experiment: Experiment) -> RunFiles:
    """Look through the run directory. Raises SoftprintError where a report makes no sense yet: without a
    body, without a test scene, or without a full-space motion of every test scene."""
    verb = _Commands(experiment, folder)
    body = folder / "body.h5"
    if not body.is_file():
        raise SoftprintError(
            f"{body} is not there, so there is nothing to report on: run {verb('body')} first"
        )
    scenes = judged_scenes(experiment)
    if not scenes:
        raise SoftprintError(
            f'{experiment.path}: a report needs a held-out motion; add a [[scenes]] table with role = "test" and one '
            "collider that is led along keyframes"
        )
    for scene in scenes:
        path = motion_path(folder, scene.name, FULL)
        if not path.is_file():
            raise SoftprintError(
                f"{path} is not there: a report compares with the full-space motion of every test scene; "
                f"run {verb('simulate', '--model full')} first"
            )
    truth = folder / "truth.h5"
    corrections = {path.stem: path for path in sorted((folder / "corrections").glob("*.safetensors"))}
    return RunFiles(folder, body, truth if truth.is_file() else None, corrections)


def missing_notes(files: RunFiles, experiment: Experiment) -> list[str]:
    """Sentences on what the report has to do without, and which verb makes it."""
    verb = _Commands(experiment, files.folder)
    notes = [
        f"The scene \u201c{scene.name}\u201d is not judged: a report compares the contact of one collider that is led "
        "along keyframes."
        for scene in experiment.scenes_of_role("test")
        if not _can_be_judged(scene)
    ]
    if files.truth is None:
        notes.append(f"There is no ground truth ({files.folder / 'truth.h5'}) yet: run {verb('generate')}.")
    if not files.corrections:
        notes.append(f"No correction has been trained yet: run {verb('train')}.")
    for scene in judged_scenes(experiment):
        absent = [name for name in files.models if not motion_path(files.folder, scene.name, name).is_file()]
        if absent:
            which = " ".join(f"--model {name}" for name in absent)
            notes.append(
                f"{', '.join(absent)} {'has' if len(absent) == 1 else 'have'} not simulated the scene "
                f"\u201c{scene.name}\u201d: run {verb('simulate', which)}."
            )
    return notes


def load_motions(
    files: RunFiles, experiment: Experiment, scene: SceneSpec, body: ReducedBody
) -> dict[str, Motion]:
    """The motions of a scene by model, full space first; those of another body, or of what the experiment and
    the corrections were before, are refused."""
    again = _Commands(experiment, files.folder)
    motions: dict[str, Motion] = {}
    for name in files.models:
        path = motion_path(files.folder, scene.name, name)
        if not path.is_file():
            continue
        motion = load_motion(path)
        if motion.inputs_hash != inputs_hash(experiment, body, scene, files.folder, name):
            before = "of another body" if motion.body_hash != body.content_hash else "from other inputs"
            raise SoftprintError(
                f"{path}: was simulated {before} than there are now: simulate the scene again with "
                f"{again('simulate', f'--scene {scene.name} --model {name}')}"
            )
        motions[name] = motion
    return motions


def used_paths(files: RunFiles, scenes: Sequence[SceneSpec]) -> list[Path]:
    """Every file that goes into the report."""
    motions = [motion_path(files.folder, scene.name, name) for scene in scenes for name in files.models]
    paths = [files.body, files.truth, *files.corrections.values(), *motions]
    return [path for path in paths if path is not None and path.is_file()]


class _Commands:
    """The command line of a verb, as the user would type it."""

    def __init__(self, experiment: Experiment, folder: Path) -> None:
        usual = Path("runs") / experiment.name
        self._rest = f"{experiment.path}" + ("" if folder == usual else f" --out {folder}")

    def __call__(self, verb: str, options: str = "") -> str:
        return f"`{' '.join(filter(None, ('softprint', verb, self._rest, options)))}`"
