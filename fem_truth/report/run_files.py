"""The files of one experiment in a run directory, and the commands that make missing ones."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from softprint.runtime.body.body import ReducedBody
from softprint.runtime.errors import SoftprintError
from softprint.runtime.experiment import Experiment, SceneSpec
from softprint.runtime.experiment.experiment import CONDENSED, FULL
from softprint.runtime.mechanics.mechanics_file import PATTERN as MECHANICS_FILES
from softprint.runtime.scenes.corrected_body import internal_path
from softprint.runtime.scenes.motion_file import Motion, load_motion
from softprint.runtime.scenes.playing import internal_models, joint_models
from softprint.runtime.scenes.simulate import inputs_hash, motion_path

BARE = "bare"


@dataclass(frozen=True)
class RunFiles:
    """Paths of the existing files; corrections, and internal ones, by name in alphabetical order; joint: the models of
    two of them that have played a scene, see `ModelName`."""

    folder: Path
    body: Path
    truth: Path | None
    corrections: dict[str, Path]
    internal: dict[str, Path]
    joint: tuple[str, ...] = ()

    @property
    def models(self) -> list[str]:
        """The models with which a scene may have been simulated."""
        condensed = [CONDENSED] if self.internal else []
        return [FULL, BARE, *self.corrections, *condensed, *self.internal, *self.joint]

    @property
    def trained(self) -> dict[str, Path]:
        """Corrections and internal ones."""
        return {**self.corrections, **self.internal}


def judged_scenes(experiment: Experiment) -> list[SceneSpec]:
    """The test scenes that a report evaluates: those with one collider with keyframes, or none, because full space must
    be able to simulate them and contact is compared for a single collider."""
    return [scene for scene in experiment.scenes_of_role("test") if _can_be_judged(scene)]


def _can_be_judged(scene: SceneSpec) -> bool:
    return len(scene.colliders) < 2 and not any(entry.free for entry in scene.colliders)


def find_run_files(folder: Path, experiment: Experiment) -> RunFiles:
    """Find the files in the run directory. Raises SoftprintError if there is no body, no test scene, or no full-space
    motion of a test scene."""
    verb = _Commands(experiment, folder)
    body = folder / "body.h5"
    if not body.is_file():
        raise SoftprintError(
            f"{body} does not exist, so there is nothing to report on: run {verb('body')} first"
        )
    scenes = judged_scenes(experiment)
    if not scenes:
        raise SoftprintError(
            f'{experiment.path}: a report needs a held-out motion; add a [[scenes]] table with role = "test" and one '
            "collider that moves along keyframes, or none"
        )
    for scene in scenes:
        path = motion_path(folder, scene.name, FULL)
        if not path.is_file():
            raise SoftprintError(
                f"{path} does not exist: a report compares with the full-space motion of every test scene; "
                f"run {verb('simulate', '--model full')} first"
            )
    truth = folder / "truth.h5"
    corrections = {path.stem: path for path in sorted((folder / "corrections").glob("*.safetensors"))}
    internal = {name: internal_path(folder, name) for name in internal_models(folder)}
    joint = tuple(
        name
        for name in joint_models(folder)
        if any(motion_path(folder, scene.name, name).is_file() for scene in scenes)
    )
    return RunFiles(folder, body, truth if truth.is_file() else None, corrections, internal, joint)


def missing_notes(files: RunFiles, experiment: Experiment) -> list[str]:
    """Sentences on missing inputs of the report, and the commands that make them."""
    verb = _Commands(experiment, files.folder)
    notes = [
        f"The scene \u201c{scene.name}\u201d is not evaluated: a report compares the contact of one collider "
        "that moves along keyframes."
        for scene in experiment.scenes_of_role("test")
        if not _can_be_judged(scene)
    ]
    if files.truth is None:
        notes.append(f"There is no ground truth ({files.folder / 'truth.h5'}) yet: run {verb('generate')}.")
    if not files.trained:
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
    """The motions of a scene by model, full space first. Raises SoftprintError for those of another body, or of an
    earlier version of the experiment or the corrections."""
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
    """Every input file of the report."""
    motions = [motion_path(files.folder, scene.name, name) for scene in scenes for name in files.models]
    mechanics = sorted(files.folder.glob(MECHANICS_FILES))
    paths = [files.body, files.truth, *mechanics, *files.trained.values(), *motions]
    return [path for path in paths if path is not None and path.is_file()]


class _Commands:
    """The command line of a verb, as the user would type it."""

    def __init__(self, experiment: Experiment, folder: Path) -> None:
        usual = Path("runs") / experiment.name
        self._rest = f"{experiment.path}" + ("" if folder == usual else f" --out {folder}")

    def __call__(self, verb: str, options: str = "") -> str:
        return f"`{' '.join(filter(None, ('softprint', verb, self._rest, options)))}`"
