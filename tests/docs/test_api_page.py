"""The page of the Python API lists what `import softprint` has, each name with the object that it is."""

from __future__ import annotations

import re
from importlib import import_module
from operator import attrgetter
from typing import Any

import softprint
from tests.docs.pages import REPOSITORY

# name on the page -> where its docstring is
LISTED = {
    heading: target
    for target, heading in re.findall(
        r"^::: ([\w.]+)\n    options: \{heading: ([\w.]+)",
        (REPOSITORY / "docs" / "api.md").read_text(encoding="utf-8"),
        re.MULTILINE,
    )
}


def found(path: str) -> Any:
    if path.startswith("softprint.runtime."):
        module, _, name = path.rpartition(".")
        return getattr(import_module(module), name)
    return attrgetter(path.removeprefix("softprint."))(softprint)


def test_every_public_name_is_on_the_page():
    public = {f"softprint.{name}" for name in softprint.__all__ if name != "colliders"}
    assert public <= set(LISTED)


def test_names_on_the_page_are_those_objects():
    named = {heading: target for heading, target in LISTED.items() if heading.startswith("softprint.")}
    assert len(named) > 40
    assert [heading for heading, target in named.items() if found(heading) is not found(target)] == []


def test_what_is_not_public_is_there():
    for heading, target in LISTED.items():
        assert found(target).__name__ == heading.rpartition(".")[2]
        assert found(target).__doc__


def test_public_names_are_sorted_and_importable():
    assert softprint.__all__ == sorted(softprint.__all__)
    assert all(getattr(softprint, name) is not None for name in softprint.__all__)
