"""What the text of an experiment that a file was made from says, without the files that it names."""

from __future__ import annotations

import json
import tomllib
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from softprint.runtime.errors import SoftprintError
from softprint.runtime.experiment.overrides import apply_override
from softprint.runtime.experiment.schema.dynamics import ContactSpec

_OVERRIDE = "# --set "  # how an override stands below the text, see `Experiment.text`


def contact_table(text: str, source: Path) -> ContactSpec:
    """The [contact] table, overrides included. Raises SoftprintError naming source, the file that the text is from."""
    try:
        data: dict[str, Any] = tomllib.loads(text)
        for line in text.splitlines():
            if line.startswith(_OVERRIDE):
                apply_override(data, line.removeprefix(_OVERRIDE))
        return ContactSpec.model_validate_json(json.dumps(data.get("contact", {}), default=str))
    except (tomllib.TOMLDecodeError, ValidationError) as error:
        raise SoftprintError(
            f"{source}: the experiment in it has no valid [contact] table: {error}"
        ) from error
