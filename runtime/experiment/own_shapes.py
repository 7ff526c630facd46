"""The mesh files that a [library] table names, and the side of the split that each of them is on."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from softprint.runtime.experiment.schema.colliders import LibraryTable
from softprint.runtime.shapes import names, validation_names
from softprint.runtime.shapes.catalogue import Role

# Without files for validation, every so manyth file to train on is one.
_EVERY = 5


@dataclass(frozen=True)
class OwnShape:
    """A mesh file, relative to the experiment file or absolute, and what it is for."""

    file: Path
    role: Role


def matches(pattern: str, base_dir: Path) -> list[Path]:
    """The files that a file name or pattern means, relative to a folder, in order."""
    whole = base_dir / pattern
    if whole.is_file():
        return [Path(pattern)]
    root = Path(whole.anchor) if Path(pattern).is_absolute() else base_dir
    found = root.glob(str(whole.relative_to(root)))
    return sorted(file if Path(pattern).is_absolute() else file.relative_to(base_dir) for file in found)


def own_shapes(library: LibraryTable, base_dir: Path) -> Mapping[str, OwnShape]:
    """The meshes by name, those to train on first. A file that is named for testing is for nothing else, and one for
    validation not for training."""
    files = {
        role: dict.fromkeys(file for pattern in patterns for file in matches(pattern, base_dir))
        for role, patterns in (
            ("test", library.test),
            ("validation", library.validation),
            ("train", library.meshes),
        )
    }
    trained = [
        file for file in files["train"] if file not in files["validation"] and file not in files["test"]
    ]
    chosen = [file for file in files["validation"] if file not in files["test"]]
    if not chosen and not set(library.shapes) & set(validation_names()):
        chosen = sorted(trained)[_EVERY // 2 :: _EVERY]
    roles: dict[Path, Role] = dict.fromkeys(trained, "train")
    roles |= dict.fromkeys(chosen, "validation")
    roles |= dict.fromkeys(files["test"], "test")
    return {file.stem: OwnShape(file, role) for file, role in roles.items()}


def library_roles(own: Mapping[str, OwnShape]) -> dict[str, Role]:
    """What every shape is for, by name: those of the library, and one's own."""
    roles: dict[str, Role] = dict.fromkeys(names("train"), "train")
    roles |= dict.fromkeys(validation_names(), "validation")
    roles |= dict.fromkeys(names("test"), "test")
    return roles | {name: shape.role for name, shape in own.items()}
