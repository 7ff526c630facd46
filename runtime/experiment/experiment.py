"""An experiment as read from its file: every table, checked alone and against the others."""

from __future__ import annotations

from pathlib import Path

from pydantic import Field, PrivateAttr

from runtime.experiment.body_schema import BodySpec
from runtime.experiment.colliders_schema import ColliderSpec, LibraryTable
from runtime.experiment.dynamics_schema import ContactSpec, DynamicsSpec
from runtime.experiment.report_schema import ReportSpec
from runtime.experiment.sampling_schema import SamplingSpec
from runtime.experiment.scene_schema import SceneSpec
from runtime.experiment.section import Name, Section
from runtime.experiment.training_schema import TrainingSpec
from runtime.shapes import SHAPES, names

LIBRARY = "library"  # as the collider of sampling and training: all shapes of the library
ANY_COLLIDER = "any"  # as the collider of a correction that was learned for all of them
# Names that no collider of a file may have.
RESERVED = {LIBRARY: "stands for all shapes of [library]", ANY_COLLIDER: "stands for any collider"}


class ExperimentSpec(Section):
    """`[experiment]`: what it is called and where its random numbers start."""

    name: Name = Field(description="names the default output folder, runs/NAME")
    seed: int = Field(0, ge=0, lt=2**32, description="the one seed of all random numbers")


class Experiment(Section):
    """One experiment file. Made by `load_experiment`, which also makes sure that its tables fit together."""

    experiment: ExperimentSpec
    body: BodySpec
    colliders: tuple[ColliderSpec, ...] = ()
    library: LibraryTable | None = None
    contact: ContactSpec = ContactSpec()
    dynamics: DynamicsSpec
    sampling: SamplingSpec = SamplingSpec()
    training: TrainingSpec = TrainingSpec()
    report: ReportSpec = ReportSpec()
    scenes: tuple[SceneSpec, ...] = ()

    _path: Path = PrivateAttr(default=Path())
    _text: str = PrivateAttr(default="")

    @property
    def name(self) -> str:
        return self.experiment.name

    @property
    def seed(self) -> int:
        return self.experiment.seed

    @property
    def dim(self) -> int:
        """2 or 3: the number of entries of gravity, and of every other vector of the file."""
        return len(self.dynamics.gravity)

    @property
    def path(self) -> Path:
        """The file it was read from."""
        return self._path

    @property
    def base_dir(self) -> Path:
        """The folder to which paths in the file are relative."""
        return self._path.parent

    @property
    def text(self) -> str:
        """The text of the file with the overrides as comments below, for the metadata of what comes of it."""
        return self._text

    def with_colliders(self, colliders: tuple[ColliderSpec, ...], note: str) -> Experiment:
        """The same experiment with other [[colliders]]; the note says so below its text."""
        changed = self.model_copy(update={"colliders": colliders})
        changed._text = f"{self._text}\n# {note}"
        return changed

    @property
    def collider_names(self) -> list[str]:
        """All that `collider` knows: those of the file, and the library's where there is a [library] table."""
        own = [spec.name for spec in self.colliders]
        return own if self.library is None else [*own, *(name for name in SHAPES if name not in own)]

    def collider(self, name: str) -> ColliderSpec:
        """The collider of that name; KeyError if there is none."""
        for spec in self.colliders:
            if spec.name == name:
                return spec
        if self.library is not None and name in SHAPES:
            return self.library.spec(name)
        raise KeyError(name)

    @property
    def sampled_colliders(self) -> tuple[str, ...]:
        """The colliders that the truth is made with: one, or all shapes of the library."""
        chosen = self.sampling.collider
        if chosen == LIBRARY and self.library is not None:
            return self.library.shapes or tuple(SHAPES)
        return (chosen,)

    def contact_places(self, name: str) -> int:
        """How many contact places one of the sampled colliders meets in each state."""
        sampling = self.sampling
        testing = sampling.collider == LIBRARY and name in names("test")
        return sampling.test_places or sampling.places if testing else sampling.places

    @property
    def planned_contacts(self) -> int:
        """Of one collider in every rotation at each place, of several once at each."""
        sampled = self.sampled_colliders
        turns = self.sampling.rotations if len(sampled) == 1 else 1
        return self.sampling.states * sum(map(self.contact_places, sampled)) * turns

    def scenes_of_role(self, role: str) -> tuple[SceneSpec, ...]:
        """The scenes of one role, `record` or `test`, in the order of the file."""
        return tuple(scene for scene in self.scenes if scene.role == role)
