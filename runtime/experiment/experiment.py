"""An experiment read from its file, with every table checked alone and against the others."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property
from pathlib import Path

from pydantic import Field, PrivateAttr

from softprint.runtime.colliders.kinds.registry import ColliderSpec
from softprint.runtime.experiment.own_shapes import OwnShape, library_roles, own_shapes
from softprint.runtime.experiment.schema.body import BodySpec
from softprint.runtime.experiment.schema.colliders import LibraryTable
from softprint.runtime.experiment.schema.dynamics import ContactSpec, DynamicsSpec
from softprint.runtime.experiment.schema.report import ReportSpec
from softprint.runtime.experiment.schema.sampling import SamplingSpec
from softprint.runtime.experiment.schema.scene import SceneSpec
from softprint.runtime.experiment.schema.section import Name, Section
from softprint.runtime.experiment.schema.training import TrainingSpec
from softprint.runtime.shapes import SHAPES
from softprint.runtime.shapes.catalogue import Role

LIBRARY = "library"  # collider of sampling and training: all shapes of the library
ANY_COLLIDER = "any"  # collider of a correction that was trained for all colliders
# Names that no collider of a file may have.
RESERVED = {LIBRARY: "stands for all shapes of [library]", ANY_COLLIDER: "stands for any collider"}

FULL = "full"  # the model of full space
CONDENSED = "condensed"  # the model of static condensation alone


class ExperimentSpec(Section):
    """`[experiment]`: its name and the seed of its random numbers."""

    name: Name = Field(description="name, also of the default output folder runs/NAME")
    seed: int = Field(0, ge=0, lt=2**32, description="the one seed of all random numbers")


class Experiment(Section):
    """One experiment file. Made by `load_experiment`, which also checks that its tables are consistent."""

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
        """The text of the file with the overrides as comments below, for the metadata of output files."""
        return self._text

    def with_colliders(self, colliders: tuple[ColliderSpec, ...], note: str) -> Experiment:
        """The same experiment with other [[colliders]]; the note is added below its text."""
        changed = self.model_copy(update={"colliders": colliders})
        changed._text = f"{self._text}\n# {note}"
        return changed

    @property
    def collider_names(self) -> list[str]:
        """All valid names of `collider`: those of the file, and the library's if there is a [library] table."""
        own = [spec.name for spec in self.colliders]
        if self.library is None:
            return own
        return [*own, *(name for name in (*self.own_shapes, *SHAPES) if name not in own)]

    @cached_property
    def own_shapes(self) -> Mapping[str, OwnShape]:
        """The mesh files of the [library] table by name; none without that table."""
        return {} if self.library is None else own_shapes(self.library, self.base_dir)

    @property
    def library_roles(self) -> Mapping[str, Role]:
        """What every shape that may be in a truth of many colliders is for: training, validation or testing."""
        return library_roles(self.own_shapes)

    def collider(self, name: str) -> ColliderSpec:
        """The collider of that name; KeyError if there is none."""
        for spec in self.colliders:
            if spec.name == name:
                return spec
        if self.library is not None and name in self.own_shapes:
            return self.library.mesh_spec(self.own_shapes[name].file)
        if self.library is not None and name in SHAPES:
            return self.library.spec(name)
        raise KeyError(name)

    @property
    def sampled_colliders(self) -> tuple[str, ...]:
        """The colliders that the truth is made with: one, or the shapes of the library and one's own. None, for a truth
        of states alone, if the experiment has no collider."""
        chosen = self.sampling.collider
        if chosen == LIBRARY and self.library is not None:
            own = tuple(self.own_shapes)
            return (*own, *(self.library.shapes or (() if own else SHAPES)))
        return (chosen,) if chosen or self.colliders else ()

    def contact_places(self, name: str) -> int:
        """Number of contact places of a sampled collider in each state."""
        sampling = self.sampling
        testing = sampling.collider == LIBRARY and self.library_roles[name] == "test"
        return sampling.test_places or sampling.places if testing else sampling.places

    @property
    def planned_contacts(self) -> int:
        """Number of contacts: a single collider has every rotation at each place, several colliders have one each."""
        sampled = self.sampled_colliders
        turns = max(1, self.sampling.rotations) if len(sampled) == 1 else 1
        return self.sampling.states * sum(map(self.contact_places, sampled)) * turns

    def scenes_of_role(self, role: str) -> tuple[SceneSpec, ...]:
        """The scenes of one role, `record` or `test`, in the order of the file."""
        return tuple(scene for scene in self.scenes if scene.role == role)
