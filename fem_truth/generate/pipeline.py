"""All stages of `softprint generate`, the same on every rank: body, states, contacts, truth file."""

from __future__ import annotations

import fcntl
import json
import resource
import shutil
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from mpi4py import MPI

from softprint.fem_truth.elasticity.full_space_elasticity import FullSpaceElasticity
from softprint.fem_truth.generate.contact_work import ContactWork
from softprint.fem_truth.generate.farm import (
    Budget,
    Groups,
    first_rank_first,
    on_first_rank,
    share_units,
    wait_idly,
)
from softprint.fem_truth.generate.merge import merge_shards
from softprint.fem_truth.generate.plan_hash import (
    SAMPLED,
    check_manifest,
    fingerprint,
    has_begun_after,
    refuse_changes,
    write_manifest,
)
from softprint.fem_truth.generate.shards import is_whole, write_shard
from softprint.fem_truth.generate.state_stage import Columns, find_states
from softprint.fem_truth.parts.body_part import part_of_body
from softprint.fem_truth.sampling.contact_approach import ContactApproaches
from softprint.fem_truth.sampling.contact_places import places_by_state
from softprint.fem_truth.sampling.contact_plan import ROTATIONS_STREAM, ContactPlan
from softprint.fem_truth.sampling.rotations import spread_rotations
from softprint.fem_truth.statics.constrained import ConstrainedProblem
from softprint.fem_truth.statics.newton import FullSpaceSettings
from softprint.runtime.body.body import ReducedBody
from softprint.runtime.cli.progress import Progress, Stage
from softprint.runtime.colliders.build import build_collider
from softprint.runtime.colliders.collider import Collider
from softprint.runtime.colliders.size_check import check_size
from softprint.runtime.contact import PenaltyContact
from softprint.runtime.errors import SoftprintError
from softprint.runtime.optimise import NewtonSettings
from softprint.runtime.truth.truth_file import TruthHeader, load_truth, side_file, write_side_file

if TYPE_CHECKING:
    from softprint.runtime.experiment import Experiment


@dataclass(frozen=True)
class Options:
    """Limits of this run. units: stop after this many new contacts; minutes: start no new contact after this time;
    resume: keep finished work; ranks_per_solve: number of ranks over which the body is partitioned, which solve a
    contact together; progress(total, unit, desc) and stage(desc): make progress bars and clocks."""

    units: int | None = None
    minutes: float | None = None
    resume: bool = True
    ranks_per_solve: int = 1
    progress: Callable[[int, str, str], Progress] = lambda total, *_: Progress(total, silent=True)
    stage: Callable[[str], Stage] = lambda desc: Stage(desc, silent=True)


@dataclass(frozen=True)
class Run:
    """Result of one call of :func:`generate`: contacts solved in it, wall time [s], largest memory of a rank
    [bytes]."""

    truth: Path
    solved: int
    seconds: float
    peak_memory: int


def generate(
    comm: MPI.Intracomm, experiment: Experiment, body: ReducedBody, out: Path, options: Options = Options()
) -> Run:
    """Compute ``out``/truth.h5 as far as experiment and options ask for. Collective; raises SoftprintError on
    all ranks.

    When this returns, the truth file contains all finished contacts, whether it is complete or not. Shards are kept
    until it is complete.
    """
    began = time.monotonic()
    groups = Groups.of(comm, options.ranks_per_solve)
    truth, folder = out / "truth.h5", out / "shards"
    on_first_rank(comm, lambda: _refuse_unchosen(experiment))
    made_from = on_first_rank(comm, lambda: fingerprint(experiment, body))
    with _only_generator(comm, out):
        if on_first_rank(comm, lambda: options.resume and _is_complete(truth, folder, made_from)):
            on_first_rank(comm, lambda: _tidy_up(truth, folder))
            return Run(truth, 0, time.monotonic() - began, _peak_memory(comm))
        on_first_rank(comm, lambda: _prepare_folder(folder, made_from, options.resume))
        on_first_rank(comm, lambda: _refuse_barrier(experiment))
        on_first_rank(comm, lambda: _refuse_depth(experiment, body.mesh.size))
        names = experiment.sampled_colliders
        colliders = [cache(partial(sampled_collider, experiment, name, body)) for name in names]
        # One that cannot be used is refused before anything is solved. All shapes of a library are as large as the
        # first.
        with options.stage("preparing full space"):
            problem = _problem(groups, experiment, body)
            size = on_first_rank(comm, lambda: colliders[0]().size if colliders else 0.0)
        states, refused = find_states(groups, folder, experiment, problem, options.progress)
        if not colliders:
            on_first_rank(
                comm,
                lambda: _write_truth(truth, folder, body, None, (), states, refused, made_from, experiment),
            )
            return Run(truth, 0, time.monotonic() - began, _peak_memory(comm))
        with options.stage("planning contacts"):
            work = _contact_work(comm, experiment, problem, states, colliders, size)

        pending = on_first_rank(comm, lambda: _without_shards(folder, len(work.plan)))
        n_before = len(work.plan) - len(pending)
        budget = Budget(options.units, None if options.minutes is None else began + 60 * options.minutes)

        def solve(unit: int) -> None:
            tables = work.solve(unit)
            if groups.leads:
                write_shard(_shard(folder, unit), tables)

        with options.progress(len(work.plan), "contacts", "truth") as bar:
            bar.skip(n_before)
            share_units(
                groups, pending, solve, budget, lambda taken: bar.update(n_before + taken - bar.count)
            )
            bar.update(sum(_shard(folder, unit).exists() for unit in pending) + n_before - bar.count)

        def finish() -> int:
            return (
                _write_truth(truth, folder, body, work.plan, names, states, refused, made_from, experiment)
                - n_before
            )

        with options.stage(f"writing {truth.name}"):
            solved = on_first_rank(comm, finish)
    return Run(truth, solved, time.monotonic() - began, _peak_memory(comm))


def _write_truth(
    truth: Path,
    folder: Path,
    body: ReducedBody,
    plan: ContactPlan | None,
    colliders: tuple[str, ...],
    states: Columns,
    refused: Columns,
    made_from: dict[str, str],
    experiment: Experiment,
) -> int:
    """Merge all finished contacts and return their number; the shards are removed when none is missing. plan: None for
    a truth of states alone."""
    planned = 0 if plan is None else len(plan)
    finished = [unit for unit in range(planned) if _shard(folder, unit).exists()]
    header = TruthHeader(
        body_hash=body.content_hash,
        experiment=experiment.text,
        seed=experiment.seed,
        colliders=colliders,
        planned_contacts=planned,
        made_from=made_from,
    )
    merge_shards(truth, header, body, states, refused, (_shard(folder, unit) for unit in finished))
    if len(finished) == planned:
        shutil.rmtree(folder)
    return len(finished)


def _without_shards(folder: Path, planned: int) -> list[int]:
    """The contacts of which there is no complete shard; a damaged one is removed."""
    pending = [unit for unit in range(planned) if not is_whole(_shard(folder, unit))]
    for unit in pending:
        _shard(folder, unit).unlink(missing_ok=True)
    return pending


def _shard(folder: Path, unit: int) -> Path:
    return folder / f"contact_{unit:06d}.shard"


def _is_complete(truth: Path, folder: Path, made_from: dict[str, str]) -> bool:
    """Whether the truth file exists and is complete, and no run has begun to make it anew since then; raises
    SoftprintError if it was made from other inputs."""
    if not truth.exists() or has_begun_after(folder, truth):
        return False
    try:
        with load_truth(truth) as data:
            before, complete = dict(data.header.made_from), data.complete
            if SAMPLED in made_from:  # older truth files lack it
                before.setdefault(SAMPLED, json.dumps(data.header.colliders))
    except SoftprintError as error:
        raise SoftprintError(f"{error}; `softprint generate --no-resume` starts again") from error
    refuse_changes(truth, before, made_from)
    return complete


def _tidy_up(truth: Path, folder: Path) -> None:
    """Finish the clean-up if an earlier run was killed after the truth file was complete."""
    shutil.rmtree(folder, ignore_errors=True)
    if not side_file(truth).is_file():
        write_side_file(truth)


def _prepare_folder(folder: Path, made_from: dict[str, str], resume: bool) -> None:
    if not resume and folder.exists():
        shutil.rmtree(folder)
    folder.mkdir(parents=True, exist_ok=True)
    if not check_manifest(folder, made_from):
        write_manifest(folder, made_from)


def _problem(groups: Groups, experiment: Experiment, body: ReducedBody) -> ConstrainedProblem:
    part = part_of_body(body, groups.solve)
    elasticity = first_rank_first(groups.world, lambda: FullSpaceElasticity(body, part=part))
    gravity = np.array(experiment.dynamics.gravity, dtype=float)
    return ConstrainedProblem(elasticity, gravity, PenaltyContact.of(experiment.contact), body)


def _contact_work(
    comm: MPI.Intracomm,
    experiment: Experiment,
    problem: ConstrainedProblem,
    states: Columns,
    colliders: Sequence[Callable[[], Collider]],
    size: float,
) -> ContactWork:
    """colliders: build them, each once; size: of the first [m]."""
    sampling, seed, body = experiment.sampling, experiment.seed, problem.body
    names = experiment.sampled_colliders
    counts = tuple(map(experiment.contact_places, names))
    clearance = sampling.frame_clearance * size
    places = on_first_rank(
        comm, lambda: places_by_state(body, max(counts), len(states["rows"]), clearance, sampling.region)
    )
    rotations = None
    if sampling.rotations:
        rotations = spread_rotations(
            body.dim, sampling.rotations, np.random.default_rng([seed, ROTATIONS_STREAM])
        )
    reduced = np.stack([body.reduced_positions(rows) for rows in states["rows"]])
    n_rotations = max(1, sampling.rotations)
    turns = n_rotations if len(names) == 1 else 1
    approaches = ContactApproaches(
        body=body,
        colliders=colliders,
        plan=ContactPlan(len(reduced), counts, n_rotations, turns, sampling.repeat_share, seed),
        internal=reduced + states["internal"],
        places=places,
        rotations=rotations,
        max_depth=sampling.max_depth,
        on_facets=experiment.contact.refinement > 0,
    )
    return ContactWork(
        problem=problem,
        approaches=approaches,
        rows=states["rows"],
        depths=sampling.depths,
        depth_noise=sampling.depth_noise,
        settings=FullSpaceSettings(
            NewtonSettings(sampling.solver.max_iterations, sampling.solver.residual),
            sampling.solver.decrement,
        ),
    )


def sampled_collider(experiment: Experiment, name: str, body: ReducedBody) -> Collider:
    """One of the colliders that the truth is made with. Raises SoftprintError if it has no bounds, or if it is so large
    that it must be in another unit than the body."""
    collider = build_collider(experiment.collider(name), experiment.base_dir)
    if not np.isfinite(collider.upper - collider.lower).all():
        raise SoftprintError(
            f"sampling.collider = {name!r} has no bounds: a contact needs a collider that can come "
            "from outside; take a box, a cylinder or a mesh"
        )
    check_size(collider, body.mesh.size)
    return collider


def _refuse_barrier(experiment: Experiment) -> None:
    if experiment.contact.model == "barrier":
        raise SoftprintError(
            f'{experiment.path}: contact.model = "barrier" is for motions in full space (`softprint simulate --model '
            "full`); reference samples are solved with a penalty: leave contact.model out to generate them"
        )


def _refuse_depth(experiment: Experiment, size: float) -> None:
    depth = experiment.sampling.max_depth
    if experiment.sampled_colliders and depth > size:
        raise SoftprintError(
            f"{experiment.path}: sampling.max_depth = {depth:g} m is more than the body is large, {size:.3g} m; "
            "lengths are in metres"
        )


def _refuse_unchosen(experiment: Experiment) -> None:
    if "" in experiment.sampled_colliders:
        names = ", ".join(repr(spec.name) for spec in experiment.colliders)
        raise SoftprintError(
            f"{experiment.path}: sampling.collider is missing, and there are several colliders: name the one that "
            f'samples are made with ({names}), or "library" for those of a [library] table'
        )


@contextmanager
def _only_generator(comm: MPI.Intracomm, out: Path) -> Iterator[None]:
    """Allow one `generate` at a time in a folder, by a lock that the operating system releases when a process ends."""
    lock = out / ".generate.lock"

    def take() -> None:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            raise SoftprintError(
                f"another `softprint generate` is running in {out}: wait for it or end it"
            ) from error

    try:
        file = lock.open("a")
    except OSError as error:
        raise SoftprintError(f"cannot write {lock}: {error.strerror}") from error
    with file:
        on_first_rank(comm, take)
        yield
        wait_idly(comm)


def _peak_memory(comm: MPI.Comm) -> int:
    """Largest peak resident memory of any rank [bytes]."""
    kibibytes = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return int(comm.allreduce(kibibytes, op=MPI.MAX)) * 1024
