"""Problems of an experiment file as sentences: key, reason, the value found, and the remedy."""

from __future__ import annotations

import difflib
import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, get_args

from pydantic import BaseModel, ValidationError
from pydantic.fields import FieldInfo
from pydantic_core import ErrorDetails

from softprint.runtime.errors import SoftprintError

Location = Sequence[str | int]
_NO_VALUE = object()


@dataclass(frozen=True)
class Problem:
    """One problem. got: the offending value, if there is one."""

    key: str
    wrong: str
    remedy: str = ""
    got: object = _NO_VALUE

    def __str__(self) -> str:
        got = "" if self.got is _NO_VALUE else f" (got {shown(self.got)})"
        remedy = f"; {self.remedy}" if self.remedy else ""
        return f"[{self.key}] {self.wrong}{got}{remedy}"


def raise_problems(path: Path, problems: Sequence[Problem]) -> None:
    """Raise a SoftprintError that lists all problems of a file; do nothing when there are none."""
    if problems:
        raise SoftprintError("\n".join(f"{path}: {problem}" for problem in problems))


def shown(value: object) -> str:
    """A value in TOML syntax, shortened."""
    try:
        text = json.dumps(value)
    except TypeError:
        text = str(value)
    return text if len(text) <= 60 else f"{text[:57]}..."


def key_of(location: Location) -> str:
    """`colliders[0].radius` from ("colliders", 0, "radius")."""
    key = ""
    for part in location:
        key += f"[{part}]" if isinstance(part, int) else f".{part}" if key else part
    return key


def problems_of(error: ValidationError, model: type[BaseModel], data: Any) -> list[Problem]:
    """One problem for each key that pydantic refuses; the alternatives of a union are joined by "or"."""
    found: dict[str, Problem] = {}
    for details in error.errors(include_url=False):
        problem = _problem(details, model, data)
        if problem.key in found and problem.wrong not in found[problem.key].wrong:
            earlier = found[problem.key]
            problem = Problem(
                problem.key, f"{earlier.wrong}, or {problem.wrong}", earlier.remedy, earlier.got
            )
        found[problem.key] = problem
    return list(found.values())


def _problem(details: ErrorDetails, model: type[BaseModel], data: Any) -> Problem:
    location = _in_the_file(details, data)
    key, kind = key_of(location), details["type"]
    if kind == "missing" and isinstance(details["loc"][-1], int):
        return Problem(key, "has too few entries", _described(model, details["loc"]), details["input"])
    if kind == "missing":
        return Problem(key, "is missing", _described(model, details["loc"]))
    if kind == "extra_forbidden":
        known = sorted({name for owner in _owners(model, details["loc"][:-1]) for name in owner.model_fields})
        near = difflib.get_close_matches(str(location[-1]), known, n=1)
        remedy = f"did you mean `{near[0]}`?" if near else f"known keys here: {', '.join(known)}"
        return Problem(key, "is not a known key", remedy)
    if kind == "union_tag_not_found":
        return Problem(key_of([*location, "shape"]), "is missing", "it says which shape this collider has")
    if kind == "union_tag_invalid":
        context = details.get("ctx", {})
        remedy = f"known shapes: {str(context.get('expected_tags', '')).replace(chr(39), '')}"
        return Problem(key_of([*location, "shape"]), "is not a known shape", remedy, context.get("tag"))
    wrong = details["msg"].removeprefix("Value error, ").removeprefix("Input ").removeprefix("should ")
    wrong = f"should {wrong}" if details["msg"].startswith("Input should") else wrong
    wrong = wrong.replace("be an object", "be a table").replace("a valid array", "a list")
    wrong = wrong.replace("List should", "should").replace(" after validation", "")
    if kind == "string_pattern_mismatch":
        wrong = "should hold only letters, digits, '_', '-' and '.', and begin with a letter or a digit"
    value = details["input"]
    return Problem(key, wrong, _described(model, details["loc"]), value)


def _in_the_file(details: ErrorDetails, data: Any) -> Location:
    """The location without the entries that pydantic adds for branches of unions."""
    location: list[str | int] = []
    here: Any = data
    part: Any
    last = len(details["loc"]) - 1
    for number, part in enumerate(details["loc"]):
        in_list = isinstance(here, list) and isinstance(part, int)
        if (isinstance(here, dict) and part in here) or (in_list and part < len(here)):
            location.append(part)
            here = here[part]
        elif in_list:
            break  # an entry that the list lacks
        elif number == last and details["type"] == "missing":
            location.append(part)
    return location


def _described(model: type[BaseModel], location: Location) -> str:
    """The description of the innermost key of a location that has one."""
    texts = [
        field.description for field, _ in _walk(model, location) if field is not None and field.description
    ]
    return texts[-1] if texts else ""


def _owners(model: type[BaseModel], location: Location) -> list[type[BaseModel]]:
    """The models that are possible at a location."""
    return [[model], *(owners for _, owners in _walk(model, location))][-1]


def _walk(
    model: type[BaseModel], location: Location
) -> Iterator[tuple[FieldInfo | None, list[type[BaseModel]]]]:
    """For each step of a location: the field it names, if any, and the models that are possible there."""
    owners = [model]
    for part in location:
        named = [
            owner.model_fields[part]
            for owner in owners
            if isinstance(part, str) and part in owner.model_fields
        ]
        if named:
            owners = _models_in(named[0])
        elif isinstance(part, str):
            owners = _of_shape(owners, part)
        yield (named[0] if named else None), owners


def _of_shape(owners: list[type[BaseModel]], tag: str) -> list[type[BaseModel]]:
    chosen = [
        owner
        for owner in owners
        if "shape" in owner.model_fields and tag in get_args(owner.model_fields["shape"].annotation)
    ]
    return chosen or owners


def _models_in(field: FieldInfo) -> list[type[BaseModel]]:
    """All models named in a field's annotation, through tuples, lists and unions."""
    found: list[type[BaseModel]] = []
    pending: list[Any] = [field.annotation]
    while pending:
        annotation = pending.pop()
        if isinstance(annotation, type) and issubclass(annotation, BaseModel):
            found.append(annotation)
        pending.extend(get_args(annotation))
    return found
