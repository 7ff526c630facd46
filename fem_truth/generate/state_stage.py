"""Selects the states of the truth: recorded frames in farthest-point order, or states of random forces, until enough
have a stable internal equilibrium."""

from __future__ import annotations

import logging
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from softprint.fem_truth.generate.farm import Groups, on_first_rank, share_units, wait_idly
from softprint.fem_truth.generate.shards import Column, Tables, is_whole, read_shard, write_shard
from softprint.fem_truth.sampling.forced_states import forced_states
from softprint.fem_truth.sampling.recorded_states import (
    Recording,
    disturbed_states,
    n_frames,
    record_scenes,
    spread_states,
)
from softprint.fem_truth.statics.constrained import ConstrainedProblem
from softprint.runtime.body.body import ReducedBody
from softprint.runtime.cli.progress import Progress
from softprint.runtime.errors import SoftprintError

if TYPE_CHECKING:
    from softprint.runtime.experiment import Experiment

log = logging.getLogger(__name__)

# Number of candidates tried per requested state before the experiment is refused.
_TRIES = 4
# Spread of disturbed states, in sizes of the body, if the experiment gives none; and the stream of their numbers.
_DISTURBANCE, _DISTURBANCE_STREAM = 0.01, 23
# The longest move of states of random forces, in sizes of the body, if the experiment gives none; and their stream.
_LONGEST, _FORCE_STREAM = 0.1, 29

Columns = dict[str, Column]


def find_states(
    groups: Groups,
    folder: Path,
    experiment: Experiment,
    problem: ConstrainedProblem,
    progress: Callable[[int, str, str], Progress],
) -> tuple[Columns, Columns]:
    """Columns of the tables `states` (as many rows as the experiment asks for) and `refused`. Collective.
    progress(total, unit, desc): makes progress bars.

    Recording and candidates are kept as shards in ``folder``: a resumed run reads them. When this returns, all ranks
    have read them.
    """
    wanted = experiment.sampling.states
    on_first_rank(
        groups.world, lambda: _record(folder / "recording.shard", experiment, problem.body, progress)
    )
    recording = read_shard(folder / "recording.shard")["recording"]
    n_candidates = len(recording["rows"])

    accepted: list[Columns] = []
    refused: list[Columns] = []
    while len(accepted) < wanted:
        tried = len(accepted) + len(refused)
        batch = range(tried, min(tried + wanted - len(accepted), n_candidates))
        if not batch:
            reasons = (
                "; ".join(sorted({str(one["reason"][0]) for one in refused}))
                or "the recorded frames are too few"
            )
            raise SoftprintError(
                f"only {len(accepted)} of sampling.states = {wanted} states could be found among "
                f"{n_candidates} candidates ({reasons}): "
                "use fewer states, or record scenes that are more varied and less violent"
            )
        _solve_candidates(groups, folder, problem, recording, batch, progress)
        for candidate in batch:
            tables = read_shard(_candidate_path(folder, candidate))
            (accepted if "states" in tables else refused).append(next(iter(tables.values())))
    wait_idly(groups.world)  # so that rank 0 cannot remove a shard that another rank has yet to read
    return _stacked(accepted), _stacked(refused) if refused else _no_refused(problem.body)


def _record(
    path: Path,
    experiment: Experiment,
    body: ReducedBody,
    progress: Callable[[int, str, str], Progress],
) -> None:
    """Save the candidates for states: recorded frames in farthest-point order, or those of random forces, each followed
    by its disturbed ones."""
    if is_whole(path):
        return
    sampling = experiment.sampling
    if sampling.record_with == "forces":
        recording, order = _of_forces(experiment, body), np.arange(_TRIES * sampling.states)
    else:
        with progress(n_frames(experiment), "frames", "recording scenes") as bar:
            recording = record_scenes(experiment, body, bar.update)
        order = spread_states(body, recording.rows, _TRIES * sampling.states)
        log.info("recorded %d frames, %d of them candidates for states", len(recording.rows), len(order))
    rows, rng = recording.rows[order], np.random.default_rng([experiment.seed, _DISTURBANCE_STREAM])
    if sampling.disturbed:
        rows = disturbed_states(body, rows, sampling.disturbed, sampling.disturbance or _DISTURBANCE, rng)
        order = np.repeat(order, 1 + sampling.disturbed)
    columns = {
        "rows": rows,
        "scene": np.array([recording.scene[k] for k in order]),
        "frame": recording.frame[order],
        "time": recording.time[order],
    }
    write_shard(path, {"recording": columns})


def _of_forces(experiment: Experiment, body: ReducedBody) -> Recording:
    """Candidates in the order in which they are drawn, each of its own."""
    sampling, rng = experiment.sampling, np.random.default_rng([experiment.seed, _FORCE_STREAM])
    count, longest = _TRIES * sampling.states, sampling.longest_move or _LONGEST
    turned = any(experiment.dynamics.gravity)
    rows = forced_states(body, count, longest * body.mesh.size, turned, rng)
    return Recording(rows, ["forces"] * count, np.arange(count), np.zeros(count))


def _solve_candidates(
    groups: Groups,
    folder: Path,
    problem: ConstrainedProblem,
    recording: Columns,
    batch: range,
    progress: Callable[[int, str, str], Progress],
) -> None:
    missing = on_first_rank(
        groups.world, lambda: [k for k in batch if not is_whole(_candidate_path(folder, k))]
    )

    def solve(candidate: int) -> None:
        tables = _candidate_tables(problem, recording, candidate)
        if groups.leads:
            write_shard(_candidate_path(folder, candidate), tables)

    if missing:
        with progress(len(missing), "states", "internal equilibria") as bar:
            share_units(groups, missing, solve, progress=lambda taken: bar.update(taken - bar.count))
            bar.update(len(missing) - bar.count)


def _candidate_tables(problem: ConstrainedProblem, recording: Columns, candidate: int) -> Tables:
    rows = recording["rows"][candidate]
    origin = {key: recording[key][candidate : candidate + 1] for key in ("rows", "scene", "frame", "time")}
    solution = problem.internal_equilibrium(rows)
    if not (solution.converged and solution.stable):
        return {"refused": {**origin, "reason": np.array([solution.reason])}}
    internal = solution.x - problem.body.reduced_positions(rows)
    measures = (
        "residual",
        "decrement",
        "min_det_F",
        "min_eigenvalue",
        "energy",
        "handle_force",
        "stable",
        "seconds",
    )
    return {
        "states": {
            **origin,
            "internal": internal[None],
            **{measure: np.array([getattr(solution, measure)]) for measure in measures},
        }
    }


def _candidate_path(folder: Path, candidate: int) -> Path:
    return folder / f"candidate_{candidate:04d}.shard"


def _stacked(tables: list[Columns]) -> Columns:
    return {key: np.concatenate([table[key] for table in tables]) for key in tables[0]}


def _no_refused(body: ReducedBody) -> Columns:
    empty = {key: np.empty(0) for key in ("reason", "scene", "frame", "time")}
    return {"rows": np.empty((0, body.n_rows, body.dim)), **empty}
