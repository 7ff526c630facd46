"""Descriptions of every key of an experiment file, from its schema."""

from __future__ import annotations

import json
import types
import typing
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from pydantic import BaseModel
from pydantic.fields import FieldInfo

_NAMES = {float: "number", int: "whole number", str: "text", bool: "true or false", Path: "file"}


def described_keys(
    model: type[BaseModel], prefix: str = "", within: tuple[type[BaseModel], ...] = ()
) -> Iterator[tuple[str, str, str]]:
    """(key, kind, description) of every key below a table, in the order of the schema, tables first.

    A table's own line has the kind "table" or "tables"; of alternative tables, selected by a key, each has its own
    lines. within: the enclosing tables, which are not described again if nested in themselves.
    """
    for name, field in model.model_fields.items():
        key = f"{prefix}{name}"
        tables = list(_models(field.annotation))
        if not tables or model in tables or set(within) & set(tables):
            yield key, _kind(field) if not tables else "tables like this one", field.description or ""
            continue
        repeated = _repeats(field.annotation)
        for table in tables:
            shown = f"{key}[]" if repeated else key
            yield shown, "tables" if repeated else "table", field.description or _first_paragraph(table)
            yield from described_keys(table, f"{shown}.", (model, *within))


def _first_paragraph(table: type[BaseModel]) -> str:
    return " ".join((table.__doc__ or "").partition("\n\n")[0].split())


def _repeats(annotation: Any) -> bool:
    return typing.get_origin(annotation) in (tuple, list) or any(
        _repeats(part) for part in typing.get_args(annotation) if part is not annotation
    )


def _models(annotation: Any) -> Iterator[type[BaseModel]]:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield annotation
    for part in typing.get_args(annotation):
        yield from _models(part)


def _kind(field: FieldInfo) -> str:
    if field.is_required():
        default = "required"
    else:
        default = "optional" if field.default in (None, "") else f"default {_toml(field.default)}"
    return f"{_type_name(field.annotation)}, {default}"


def _toml(value: object) -> str:
    """A value in TOML syntax."""
    if isinstance(value, tuple):
        return f"[{', '.join(_toml(entry) for entry in value)}]"
    return f"{value:g}" if isinstance(value, float) else json.dumps(value)


def _type_name(annotation: Any) -> str:
    origin, parts = typing.get_origin(annotation), typing.get_args(annotation)
    if origin is typing.Literal:
        return " | ".join(f'"{part}"' for part in parts)
    if origin is typing.Annotated:
        return _type_name(parts[0])
    if origin in (typing.Union, types.UnionType):
        return " or ".join(dict.fromkeys(_type_name(part) for part in parts if part is not type(None)))
    if origin in (tuple, list):
        return f"list of {_type_name(parts[0])}"
    return _NAMES.get(annotation, str(annotation))
