"""Which corrections in a run directory are up to date, identified by their training recipe."""

from __future__ import annotations

import logging
from collections.abc import Callable
from pathlib import Path
from typing import Protocol, TypeVar

from softprint import runtime
from softprint.runtime.cli.context import Context
from softprint.runtime.cli.run_mechanics import RunMechanics
from softprint.runtime.errors import SoftprintError
from softprint.runtime.experiment import Experiment, ModelSpec
from softprint.runtime.experiment.experiment import CONDENSED
from softprint.runtime.io.files import content_hash, file_hash, sources_hash
from softprint.runtime.learned.correction_file import read_header
from softprint.runtime.learned.form import find_form
from softprint.runtime.scenes.corrected_body import internal_path
from softprint.runtime.scenes.playing import correction_path
from softprint.runtime.scenes.scene import held_frames

log = logging.getLogger(__name__)


def recipe_of(experiment: Experiment, spec: ModelSpec, truth_hash: str, out: Path) -> dict[str, object]:
    """Everything that determines the result of training into a run directory."""
    training = experiment.training.model_dump(mode="json", exclude={"models", "internal", "device"})
    roles = experiment.library_roles
    return {
        "truth": truth_hash,
        "model": spec.model_dump(mode="json"),
        "stiffness": experiment.contact.stiffness,
        "contact_points": [experiment.contact.refinement, experiment.contact.reduced_refinement],
        "gravity": list(experiment.dynamics.gravity),
        "settings": {**training, "seed": experiment.seed},
        "roles": {name: roles.get(name, "") for name in experiment.sampled_colliders},
        "held_frames": sorted(held_frames(experiment)),
        **internal_recipe(spec, out),
    }


def internal_recipe(spec: ModelSpec, out: Path) -> dict[str, str]:
    """The hash of the internal correction that a model is added to, if there is one. Raises SoftprintError where it is
    not trained yet."""
    if not spec.added_to or spec.added_to == CONDENSED:
        return {}
    path = internal_path(out, spec.added_to)
    if not path.is_file():
        raise SoftprintError(
            f"model {spec.name!r} is added to the internal correction {spec.added_to!r}, but there is no {path}: "
            f"`softprint train --model {spec.added_to}` makes it"
        )
    return {"internal": file_hash(path)}


def is_trained(context: Context, spec: ModelSpec, truth_hash: str, mechanics: RunMechanics) -> bool:
    """Whether the correction exists with this recipe and the mechanics of the run directory."""
    path = correction_path(context.out_dir, spec.name)
    header = kept_header(path, recipe_of(context.experiment, spec, truth_hash, context.out_dir), read_header)
    if header is None:
        return False
    if (
        find_form(spec.form).needs_mechanics
        and header.mechanics_hash != mechanics.get(spec.contact_nodes)[0].content_hash
    ):
        log.warning("%s was trained with different body mechanics; training it again", path)
        return False
    return True


class TrainedHeader(Protocol):
    """The header of a correction file."""

    @property
    def training(self) -> dict[str, object]: ...


HeaderT = TypeVar("HeaderT", bound=TrainedHeader)


def kept_header(path: Path, recipe: dict[str, object], read: Callable[[Path], HeaderT]) -> HeaderT | None:
    """The header of a correction with this recipe, as `read` reads it; None if there is none."""
    if not path.is_file():
        return None
    try:
        header = read(path)
    except SoftprintError as error:
        log.warning("%s; training it again", error)
        return None
    if {key: header.training.get(key) for key in recipe} != recipe:
        return None
    if header.training.get("program") != program_hash():
        log.warning(
            "%s is kept, but was trained by another version of the program: --no-resume trains it again", path
        )
    return header


def program_hash() -> str:
    """A hash of the sources that take part in training: with other sources, the same recipe may give other weights."""
    folders = {"runtime": Path(runtime.__file__).parent, "surrogate": Path(__file__).parent}
    return content_hash({name: sources_hash(folder) for name, folder in folders.items()})
