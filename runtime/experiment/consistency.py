"""Checks that need more than one key: dimensions, references between names, order of times, files."""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Iterator
from pathlib import Path

from softprint.runtime.colliders.surface_mesh.mesh_collider import SUFFIXES
from softprint.runtime.errors import SoftprintError
from softprint.runtime.experiment.experiment import CONDENSED, LIBRARY, RESERVED, Experiment
from softprint.runtime.experiment.own_shapes import matches
from softprint.runtime.experiment.problems import Problem
from softprint.runtime.experiment.schema.colliders import LibraryTable
from softprint.runtime.experiment.schema.scene import (
    KeyframeSpec,
    KinematicEntry,
    KinematicSpec,
    SceneColliderSpec,
    SceneSpec,
)
from softprint.runtime.learned.registry import FORMS
from softprint.runtime.shapes import SHAPES

_NAMED = 12  # limit of names listed in an error
_FARTHEST = 1.0  # limit of a free collider's displacement in its first step [m]
_POINTS_DO_NOT_TURN = "a point handle has no rotation, only frames have"


def inconsistencies(experiment: Experiment) -> list[Problem]:
    """All contradictions between the tables of an experiment, and missing files."""
    return [
        *_repeated_names(experiment),
        *_body(experiment),
        *_contact(experiment),
        *_colliders(experiment),
        *_named_colliders(experiment),
        *(
            problem
            for number, scene in enumerate(experiment.scenes)
            for problem in _scene(experiment, number, scene)
        ),
    ]


def _repeated_names(experiment: Experiment) -> Iterator[Problem]:
    lists = {
        "colliders": [spec.name for spec in experiment.colliders],
        "scenes": [spec.name for spec in experiment.scenes],
        "training.models": [spec.name for spec in experiment.training.models],
        "training.internal": [spec.name for spec in experiment.training.internal],
        "body.handles.frames": [spec.name for spec in experiment.body.handles.frames],
    }
    for key, names in lists.items():
        for number, name in enumerate(names):
            if name in names[:number]:
                yield Problem(f"{key}[{number}].name", "is used twice", "give each its own name", name)
    taken = lists["training.models"]
    for number, name in enumerate(lists["training.internal"]):
        if name in taken:
            yield Problem(
                f"training.internal[{number}].name", "is that of another model", "give it another", name
            )


def _body(experiment: Experiment) -> Iterator[Problem]:
    body = experiment.body
    yield from _file(experiment, "body.mesh", body.mesh)
    frames = list(enumerate(body.handles.frames))
    boxes = {f"body.handles.frames[{n}].box": frame.box for n, frame in frames if frame.box is not None}
    boxes |= {f"body.material.regions[{n}].box": region.box for n, region in enumerate(body.material.regions)}
    if experiment.sampling.region is not None:
        boxes["sampling.region"] = experiment.sampling.region
    for key, box in boxes.items():
        wrong_size = [problem for corner in box for problem in _vector(experiment, key, corner)]
        yield from wrong_size[:1]
        if not wrong_size and any(low >= high for low, high in zip(*box, strict=True)):
            yield Problem(key, "is empty", "the first corner must be below the second along every axis", box)
    for number, frame in frames:
        for index, segment in enumerate(frame.segments or ()):
            key = f"body.handles.frames[{number}].segments[{index}]"
            yield from [problem for end in segment for problem in _vector(experiment, key, end)][:1]
    if isinstance(body.handles.points, tuple):
        for number, point in enumerate(body.handles.points):
            yield from _vector(experiment, f"body.handles.points[{number}]", point)
    elif body.handles.points == 0 and not body.handles.frames:
        yield Problem("body.handles", "has neither points nor frames", "a reduced body needs handles")


def _contact(experiment: Experiment) -> Iterator[Problem]:
    contact = experiment.contact
    if contact.model == "barrier" and contact.friction > 0.0:
        yield Problem(
            "contact.friction", "needs a penalty", "a barrier is without friction: set 0", contact.friction
        )
    if contact.model == "penalty" and contact.distance is not None:
        yield Problem("contact.distance", "is of a barrier", 'set contact.model = "barrier", or leave it out')
    if contact.refinement == 0 and contact.reduced_refinement != 1:
        remedy = "leave contact.refinement out: with 0, contact is at nodes"
        yield Problem("contact.reduced_refinement", "has no effect", remedy, contact.reduced_refinement)


def _colliders(experiment: Experiment) -> Iterator[Problem]:
    if experiment.library is not None and experiment.dim == 2:
        yield Problem("library", "has 3D solids", "a 2D experiment defines its own [[colliders]]")
    if experiment.library is not None:
        shapes = experiment.library.shapes
        for number, name in enumerate(shapes):
            yield from _known(f"library.shapes[{number}]", name, list(SHAPES), "shape of the library")
            if name in shapes[:number]:
                yield Problem(f"library.shapes[{number}]", "is listed twice", "name each shape once", name)
        yield from _own_shapes(experiment, experiment.library)
    elif experiment.sampling.test_places is not None:
        yield Problem(
            "sampling.test_places", "is for the testing shapes of a [library]", "leave it out, or add one"
        )
    for number, spec in enumerate(experiment.colliders):
        if not spec.name:
            yield Problem(
                f"colliders[{number}].name",
                "is missing",
                "scenes and corrections refer to the collider by it",
            )
        if spec.name in RESERVED:
            yield Problem(f"colliders[{number}].name", RESERVED[spec.name], "give it another", spec.name)
        file = getattr(spec, "file", None)
        if file is not None:
            yield from _file(experiment, f"colliders[{number}].file", file)
        for key in ("half_extents", "normal", "start", "end", "position"):
            vector = getattr(spec, key, None)
            if vector is not None:
                yield from _vector(experiment, f"colliders[{number}].{key}", vector)
        flat, solid = {"circle", "polygon"}, {"sphere", "cylinder", "mesh", "library"}
        if (experiment.dim == 3 and spec.shape in flat) or (experiment.dim == 2 and spec.shape in solid):
            yield Problem(
                f"colliders[{number}].shape",
                f"does not have the {experiment.dim} dimensions of this experiment",
                "gravity's number of entries sets the dimension",
                spec.shape,
            )


def _own_shapes(experiment: Experiment, library: LibraryTable) -> Iterator[Problem]:
    names: dict[str, Path] = {}
    taken = {**dict.fromkeys(SHAPES, "a shape of the library"), **RESERVED}
    taken |= {spec.name: "a [[colliders]] table" for spec in experiment.colliders}
    for key in ("meshes", "validation", "test"):
        for number, pattern in enumerate(getattr(library, key)):
            where, files = f"library.{key}[{number}]", matches(pattern, experiment.base_dir)
            if not files:
                looked = (
                    f"looked for {experiment.base_dir / pattern}; paths are relative to the experiment file"
                )
                yield Problem(where, "matches no file", looked, pattern)
            for file in files:
                if file.suffix.lower() not in SUFFIXES:
                    right = f"one ends with {', '.join(SUFFIXES)}: narrow the pattern"
                    yield Problem(where, f"matches {file}, which is no mesh", right, pattern)
                elif file.stem in taken or names.setdefault(file.stem, file) != file:
                    other = taken.get(file.stem) or names[file.stem]
                    yield Problem(
                        where, f"matches {file}, whose name is that of {other}", "rename it", pattern
                    )


def _named_colliders(experiment: Experiment) -> Iterator[Problem]:
    names = experiment.collider_names
    for spec in experiment.colliders:
        if spec.name == experiment.sampling.collider and spec.shape == "plane":
            yield Problem(
                "sampling.collider",
                "is a plane",
                "a contact needs a bounded collider that can approach from outside, such as a box or a mesh",
                spec.name,
            )
    for key, name in (
        ("sampling.collider", experiment.sampling.collider),
        ("training.collider", experiment.training.collider),
    ):
        if name and not (name == LIBRARY and experiment.library is not None):
            yield from _known(key, name, names, "collider")
    if experiment.training.collider == LIBRARY != experiment.sampling.collider:
        yield Problem(
            "training.collider",
            "is the library, but the truth is made with one collider",
            'set sampling.collider = "library" too',
        )
    yield from _added_to(experiment)
    if experiment.training.collider == LIBRARY:
        for number, model in enumerate(experiment.training.models):
            if not FORMS[model.form].any_collider:
                yield Problem(
                    f"training.models[{number}].form",
                    "is a form of models for one collider, but training is for any",
                    f"use {' or '.join(name for name, form in FORMS.items() if form.any_collider)}",
                    model.form,
                )


def _added_to(experiment: Experiment) -> Iterator[Problem]:
    """Of models that are added to internal corrections."""
    on = {CONDENSED: "condensation"} | {own.name: own.on for own in experiment.training.internal}
    for number, model in enumerate(experiment.training.models):
        here = f"training.models[{number}]"
        if model.added_to:
            yield from _known(
                f"{here}.added_to", model.added_to, list(on), "correction of [[training.internal]]"
            )
        if FORMS[model.form].on_mechanics and model.added_to:
            own = "condensation" if model.static_condensation else "subspace"
            if model.added_to == CONDENSED:
                yield Problem(
                    f"{here}.added_to",
                    f"adds what form {model.form} has by itself",
                    "leave it out",
                    model.added_to,
                )
            elif on.get(model.added_to, own) != own:
                yield Problem(
                    f"{here}.static_condensation",
                    f"is {str(model.static_condensation).lower()}, but {model.added_to!r} is learned on the "
                    f"{on[model.added_to]}",
                    f"set it to {str(not model.static_condensation).lower()}",
                )
        if model.added_to and model.target == "whole":
            yield Problem(
                f"{here}.target",
                "is all that the subspace lacks, which the internal correction would add twice",
                'leave it out, or leave "added_to" out',
                model.target,
            )


def _scene(experiment: Experiment, number: int, scene: SceneSpec) -> Iterator[Problem]:
    here = f"scenes[{number}]"
    names = experiment.collider_names
    yield from _kinematic(experiment, f"{here}.kinematic", scene.kinematic)
    for index, collider in enumerate(scene.colliders):
        yield from _known(f"{here}.colliders[{index}].name", collider.name, names, "collider")
        yield from _scene_collider(experiment, f"{here}.colliders[{index}]", collider)
    for index, spring in enumerate(scene.springs):
        key = f"{here}.springs[{index}]"
        yield from _handle(experiment, f"{key}.handle", spring.handle)
        if spring.rotation_stiffness and not isinstance(spring.handle, str):
            yield Problem(f"{key}.rotation_stiffness", "has no effect", _POINTS_DO_NOT_TURN)
        if not spring.rotation_stiffness:
            yield from _no_rotation(
                f"{key}.keyframes", spring.keyframes, "give the frame a rotation_stiffness"
            )
        if (spring.target is None) == (spring.keyframes is None):
            yield Problem(key, "needs a target or keyframes", "give either of them")
        if spring.target is not None:
            yield from _vector(experiment, f"{key}.target", spring.target)
        if spring.keyframes is not None:
            yield from _keyframes(experiment, f"{key}.keyframes", spring.keyframes)
    if scene.tracking is not None:
        yield from _tracking(experiment, f"{here}.tracking.file", scene.tracking.file)


def _tracking(experiment: Experiment, key: str, file: Path) -> Iterator[Problem]:
    """A recorded motion, whose frames must be frames of the body."""
    from softprint.runtime.experiment.recorded_motion import read_recorded_motion  # imports numba

    missing = list(_file(experiment, key, file))
    yield from missing
    if missing:
        return
    try:
        tracks = read_recorded_motion(experiment.base_dir / file, experiment.dim)
    except SoftprintError as error:
        yield Problem(key, f"is no recorded motion: {error}", "see runtime/experiment/recorded_motion.py")
        return
    frames = [frame.name for frame in experiment.body.handles.frames]
    for track in tracks:
        yield from _known(f"{key} ({file})", track.frame, frames, "frame")


def _scene_collider(experiment: Experiment, key: str, collider: SceneColliderSpec) -> Iterator[Problem]:
    """A collider is either kinematic or free."""
    start = ("position", "rotation", "velocity", "spin")
    if not collider.free:
        if collider.keyframes is None:
            remedy = "or give a density or a mass to let it move freely from its position"
            yield Problem(f"{key}.keyframes", "is missing", remedy)
            return
        yield from _keyframes(experiment, f"{key}.keyframes", collider.keyframes)
        for name in start:
            if getattr(collider, name) is not None:
                yield Problem(
                    f"{key}.{name}", "is for colliders that move freely", "give a density or a mass"
                )
        return
    if collider.keyframes is not None:
        yield Problem(f"{key}.keyframes", "moves a collider that moves freely", "give keyframes or a density")
    if collider.density is not None and collider.mass is not None:
        yield Problem(f"{key}.mass", "is given in addition to a density", "give either of them")
    if any(spec.name == collider.name and spec.shape == "plane" for spec in experiment.colliders):
        yield Problem(
            f"{key}.name", "is a plane, which has no mass", "move it along keyframes", collider.name
        )
    if collider.position is None:
        yield Problem(f"{key}.position", "is missing", "a collider that moves freely needs a start position")
    for name in ("position", "velocity"):
        vector = getattr(collider, name)
        if vector is not None:
            yield from _vector(experiment, f"{key}.{name}", vector)
    speed = max(map(abs, collider.velocity or (0.0,)))
    if speed * experiment.dynamics.time_step > _FARTHEST:
        yield Problem(
            f"{key}.velocity",
            f"moves it {speed * experiment.dynamics.time_step:g} m in one step",
            f"at most {_FARTHEST:g} m: near other bodies its path is searched in parts shorter than its thickness",
            collider.velocity,
        )
    for name in ("rotation", "spin"):
        yield from _rotation(experiment, f"{key}.{name}", getattr(collider, name))


def _kinematic(experiment: Experiment, key: str, entries: Iterable[KinematicEntry]) -> Iterator[Problem]:
    seen: set[int | str] = set()
    for index, entry in enumerate(entries):
        here = f"{key}[{index}]"
        handle = entry.handle if isinstance(entry, KinematicSpec) else entry
        if isinstance(entry, KinematicSpec):
            yield from _keyframes(experiment, f"{here}.keyframes", entry.keyframes)
            if not isinstance(handle, str):
                yield from _no_rotation(f"{here}.keyframes", entry.keyframes, _POINTS_DO_NOT_TURN)
            here += ".handle"
        yield from _handle(experiment, here, handle)
        if handle in seen:
            yield Problem(here, "is given twice", "a handle is either fixed or moved along one path", handle)
        seen.add(handle)


def _no_rotation(key: str, keyframes: Iterable[KeyframeSpec] | None, remedy: str) -> Iterator[Problem]:
    for number, keyframe in enumerate(keyframes or ()):
        if keyframe.rotation is not None:
            yield Problem(f"{key}[{number}].rotation", "has no effect", remedy, keyframe.rotation)


def _handle(experiment: Experiment, key: str, handle: int | str) -> Iterator[Problem]:
    """A frame by name or a point by number."""
    if isinstance(handle, str):
        frames = [frame.name for frame in experiment.body.handles.frames]
        yield from _known(key, handle, frames, "frame")
        return
    points = experiment.body.handles.points
    count = points if isinstance(points, int) else len(points)
    if not 0 <= handle < count:
        remedy = (
            f"the body has {count} point handles, numbered from 0" if count else "the body has frames only"
        )
        yield Problem(key, "is not a point handle of the body", remedy, handle)


def _keyframes(experiment: Experiment, key: str, keyframes: Iterable[KeyframeSpec]) -> Iterator[Problem]:
    before: float | None = None
    for number, keyframe in enumerate(keyframes):
        yield from _vector(experiment, f"{key}[{number}].position", keyframe.position)
        yield from _rotation(experiment, f"{key}[{number}].rotation", keyframe.rotation)
        if before is not None and keyframe.time <= before:
            yield Problem(
                f"{key}[{number}].time", f"must be later than {before:g} s before it", got=keyframe.time
            )
        before = keyframe.time


def _rotation(
    experiment: Experiment, key: str, rotation: float | tuple[float, ...] | None
) -> Iterator[Problem]:
    angles = 1 if experiment.dim == 2 else 3
    if rotation is not None and (1 if isinstance(rotation, float) else len(rotation)) != angles:
        remedy = "one angle in 2D" if angles == 1 else "axis times angle, three numbers, in 3D"
        yield Problem(key, "has the wrong number of entries", remedy, rotation)


def _vector(experiment: Experiment, key: str, vector: Iterable[float]) -> Iterator[Problem]:
    entries = tuple(vector)
    if len(entries) != experiment.dim:
        yield Problem(
            key,
            f"has {len(entries)} entries",
            f"dynamics.gravity has {experiment.dim}, so the experiment is {experiment.dim}D",
            entries,
        )


def _known(key: str, name: str, names: list[str], noun: str) -> Iterator[Problem]:
    if name not in names:
        near = difflib.get_close_matches(name, names, n=1)
        few = ", ".join(names[:_NAMED]) + (", ..." if len(names) > _NAMED else "")
        remedy = f"did you mean '{near[0]}'?" if near else f"known: {few or 'none'}"
        yield Problem(key, f"is not the name of a {noun}", remedy, name)


def _file(experiment: Experiment, key: str, path: Path) -> Iterator[Problem]:
    full = experiment.base_dir / path
    if not full.is_file():
        wrong = "is a folder" if full.is_dir() else "names a file that does not exist"
        yield Problem(key, wrong, f"looked for {full}; paths are relative to the experiment file", str(path))
