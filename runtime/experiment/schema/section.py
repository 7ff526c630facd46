"""The base class of all tables of an experiment file, and types that they share."""

from __future__ import annotations

from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field


class Section(BaseModel):
    """An immutable table that rejects unknown keys."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


Positive = Annotated[float, Field(gt=0)]
NotNegative = Annotated[float, Field(ge=0)]
Count = Annotated[int, Field(ge=1)]
Share = Annotated[float, Field(ge=0, le=1)]
Name = Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_.-]*$", max_length=80)]

# Lengths in metres, speeds and the like: beyond this a unit is wrong, and squares overflow.
Coordinate = Annotated[float, Field(ge=-1e6, le=1e6)]
# The number of entries is checked against the dimension of the experiment after all tables are read.
Vector = Annotated[tuple[Coordinate, ...], Field(min_length=2, max_length=3)]
Box = Annotated[tuple[Vector, Vector], Field(description="lowest and highest corner [m]")]
