"""Merges shards into a truth file: all finished contacts in the order of the plan, one shard in memory at a time."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path

import numpy as np

from softprint.fem_truth.generate.shards import read_shard
from softprint.runtime.body.body import ReducedBody
from softprint.runtime.truth.truth_file import TruthHeader, create_truth


def merge_shards(
    path: Path,
    header: TruthHeader,
    body: ReducedBody,
    states: Mapping[str, object],
    refused: Mapping[str, object],
    shards: Iterable[Path],
) -> None:
    """Write the truth file at ``path`` from the tables of states and the contacts' shards, in the given order.

    Indices within a shard (contacts of samples, samples of repeats) are shifted to indices within the file.
    """
    with create_truth(path, header, body) as truth:
        truth.append("states", states)
        truth.append("refused", refused)
        for shard in shards:
            tables = read_shard(shard)
            contact, sample = truth.length("contacts"), truth.length("samples")
            samples, repeat = dict(tables["samples"]), dict(tables["repeat"])
            samples["contact"] = np.asarray(samples["contact"]) + contact
            repeat["sample"] = np.asarray(repeat["sample"], dtype=np.int64) + sample
            truth.append("contacts", tables["contacts"])
            truth.append("samples", samples)
            truth.append("repeat", repeat)
