"""What `softprint inspect` prints for a shard. Imports no full-space code, so that it works without DOLFINx."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from softprint.fem_truth.generate.shards import MAGIC, DamagedShard, read_shard
from softprint.runtime.errors import SoftprintError
from softprint.runtime.inspect.file_head import FileHead
from softprint.runtime.inspect.kind import Kind, Part
from softprint.runtime.inspect.summary import Summary
from softprint.runtime.truth.truth_schema import STATUS_NAMES


def recognise(head: FileHead) -> bool:
    return head.start.startswith(MAGIC) or head.suffix == ".shard"


def summarise(path: Path, part: Part) -> Summary:
    """Rows of each table; for a finished contact also the statuses of its samples. Checks the digest."""
    try:
        tables = read_shard(path)
    except DamagedShard as error:
        raise SoftprintError(
            f"{path}: a truncated or altered shard; `softprint generate` makes it again"
        ) from error
    facts: dict[str, Any] = {
        "rows": {name: len(next(iter(columns.values()))) for name, columns in tables.items() if columns},
        "bytes in memory": int(
            sum(np.asarray(c).nbytes for columns in tables.values() for c in columns.values())
        ),
    }
    if "samples" in tables:  # then it is a contact, as written by `contact_work`
        codes, counts = np.unique(tables["samples"]["status"], return_counts=True)
        facts["samples by status"] = {
            STATUS_NAMES.get(int(code), f"code {code}"): int(n) for code, n in zip(codes, counts)
        }
        facts["core-seconds"] = float(np.sum(tables["contacts"]["seconds"]))
    return Summary(path, "a shard: a finished part of `softprint generate`", {"shard": facts})


KIND = Kind(recognise, summarise)
