"""Keys and values of experiment files that had other names in earlier versions, with an error that names the current
one."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from softprint.runtime.experiment.problems import Problem

# Table -> earlier key -> current key.
KEYS: Mapping[tuple[str, ...], Mapping[str, str]] = {
    ("training",): {"field": "thesis5", "descriptor": "thesis6"},
    ("training", "models"): {"loads": "contact_nodes", "internal": "static_condensation"},
}
# Table and key -> earlier value -> current value.
VALUES: Mapping[tuple[str, ...], Mapping[str, str]] = {
    ("training", "models", "form"): {"loads": "force", "field": "thesis5", "descriptor": "thesis6"},
}


def renamed(data: Mapping[str, Any]) -> list[Problem]:
    """One problem for each earlier key and each earlier value in an experiment's data."""
    return [
        *(
            Problem(f"{key}.{earlier}", f"is now called `{present}`", "rename it")
            for table, names in KEYS.items()
            for key, found in _tables(data, table)
            for earlier, present in names.items()
            if earlier in found
        ),
        *(
            Problem(f"{key}.{name}", f'is now called "{present[found[name]]}"', "rename it", found[name])
            for (*table, name), present in VALUES.items()
            for key, found in _tables(data, tuple(table))
            if isinstance(found.get(name), str) and found[name] in present
        ),
    ]


def _tables(data: Any, path: tuple[str, ...], key: str = "") -> Iterator[tuple[str, Mapping[str, Any]]]:
    """Every table at a path, including those in lists, with its key in the file."""
    if isinstance(data, list):
        for number, entry in enumerate(data):
            yield from _tables(entry, path, f"{key}[{number}]")
    elif isinstance(data, Mapping):
        if not path:
            yield key, data
        elif path[0] in data:
            yield from _tables(data[path[0]], path[1:], f"{key}.{path[0]}" if key else path[0])
