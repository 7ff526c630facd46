"""Single keys changed from the command line: `--set sampling.places=8 --set
colliders.pointy.resolution=24`.
"""

from __future__ import annotations

import re
import tomllib
from typing import Any

from softprint.runtime.errors import SoftprintError


def apply_override(data: dict[str, Any], override: str) -> None:
    """Set one key of the tables in place.

    override: `a.b=VALUE` with VALUE as in TOML. An entry of a list of tables is named by its number
    (`scenes.0` or `scenes[0]`, from 0) or by its `name`. Raises SoftprintError if it cannot be parsed or names no
    entry.
    """
    key, equals, text = override.partition("=")
    path = re.sub(r"\[(\d+)\]", r".\1", key.strip()).split(".")
    if not equals or not all(path):
        raise SoftprintError(
            f"--set {override}: it has the form KEY.SUBKEY=VALUE, such as --set sampling.places=8"
        )
    try:
        value = tomllib.loads(f"value = {text}")["value"]
    except tomllib.TOMLDecodeError as error:
        raise SoftprintError(
            f"--set {override}: {text!r} is not a TOML value; text needs quotes, as in "
            f"--set '{key}=\"{text}\"'"
        ) from error
    here: Any = data
    for part in path[:-1]:
        here = _entry(here, part, override) if isinstance(here, list) else here.setdefault(part, {})
        if not isinstance(here, dict | list):
            raise SoftprintError(f"--set {override}: [{part}] is a value and has no further keys")
    if isinstance(here, list):
        here[_index(here, path[-1], override)] = value
    else:
        here[path[-1]] = value


def _entry(entries: list[Any], part: str, override: str) -> Any:
    return entries[_index(entries, part, override)]


def _index(entries: list[Any], part: str, override: str) -> int:
    if part.isdigit() and int(part) < len(entries):
        return int(part)
    names = [entry.get("name") if isinstance(entry, dict) else None for entry in entries]
    if part in names:
        return names.index(part)
    known = ", ".join(str(name) for name in names if name) or "none has a name"
    raise SoftprintError(
        f"--set {override}: there is no entry '{part}'; "
        f"use a number from 0 to {len(entries) - 1} or a name ({known})"
    )
