"""The work behind `softprint report`: read the run directory, judge, draw, and write both files."""

from __future__ import annotations

import json
from contextlib import ExitStack
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from fem_truth.constrained import ConstrainedProblem
from fem_truth.full_space_elasticity import FullSpaceElasticity
from fem_truth.report.assemble import JudgedScene, Material, assemble
from fem_truth.report.comparison import evenly_spaced
from fem_truth.report.headline import Card, console_lines
from fem_truth.report.held_out import Comparer, Corrected, HeldOutMotion, compare
from fem_truth.report.learning import load_learning
from fem_truth.report.page import render_page
from fem_truth.report.picture import Renderer
from fem_truth.report.renderings import make_renderer
from fem_truth.report.report_json import json_text, write_text
from fem_truth.report.run_files import (
    FULL,
    RunFiles,
    find_run_files,
    judged_scenes,
    load_motions,
    missing_notes,
    used_paths,
)
from fem_truth.report.shapes import judge_shapes
from fem_truth.report.solves import FrameSolves, SolveStore, solve_frame
from runtime.body.body import ReducedBody
from runtime.cli.run_body import body_of_run
from runtime.colliders.collider import Collider
from runtime.contact import PenaltyContact
from runtime.io.files import content_hash
from runtime.learned.correction_file import load_correction
from runtime.scenes.scene import scene_parts
from runtime.truth.truth_file import load_truth

if TYPE_CHECKING:
    from runtime.cli.context import Context
    from runtime.experiment import Experiment, SceneSpec


@dataclass(frozen=True)
class Made:
    """Where the report is, and the lines that sum it up."""

    page: Path
    numbers: Path
    headline: list[str]


def make_report(context: Context, pictures: bool = True) -> Made:
    """Judge every scene of role `test` that can be, and write report.html and report.json into the run directory."""
    experiment, folder = context.experiment, context.out_dir
    files = find_run_files(folder, experiment)
    body = body_of_run(context)
    scenes = [judge_scene(context, files, body, scene) for scene in judged_scenes(experiment)]
    with ExitStack() as stack:
        truth = None if files.truth is None else stack.enter_context(load_truth(files.truth, body))
        model = _judged_model(experiment, files)
        material = Material(
            experiment=experiment,
            body=body,
            scenes=scenes,
            truth=truth,
            learning=load_learning(files.corrections, folder),
            model=model,
            folder=folder,
            files=used_paths(files, judged_scenes(experiment)),
            notes=[*missing_notes(files, experiment), *_contact_notes(scenes)],
            shapes=None if truth is None else judge_shapes(context, files, body, truth, model, pictures),
        )
        context.say("drawing")
        content = assemble(material, _renderer if pictures else None)
    page, numbers = folder / "report.html", folder / "report.json"
    html = render_page(content)  # before anything is written: both files change, or none
    write_text(numbers, json_text(content.summary))
    write_text(page, html)
    cards = [Card(**card) for card in content.summary["headline"]["cards"]]
    return Made(page, numbers, console_lines(content.summary, cards))


def judge_scene(context: Context, files: RunFiles, body: ReducedBody, scene: SceneSpec) -> JudgedScene:
    """Compare all models on one test scene; full-space solves that an earlier run finished are read."""
    experiment = context.experiment
    motions = load_motions(files, experiment, scene, body)
    collider = _collider(experiment, scene)
    full = motions[FULL]
    # A frame is asked for by several models in a row: keep the last ones.
    motion = HeldOutMotion(
        full.times, full.colliders[collider.name].poses, lru_cache(maxsize=4)(full.positions)
    )
    comparer = Comparer(body, collider, motion, _corrections(files, body, collider))
    contact, press = comparer.contact_frames()
    if not len(contact):
        return JudgedScene(scene.name, comparer, None, motions)

    problem = ConstrainedProblem(
        FullSpaceElasticity(body),
        np.array(experiment.dynamics.gravity),
        PenaltyContact(experiment.contact.stiffness),
        body,
    )
    store = SolveStore(files.folder / "heldout" / scene.name, _solve_context(experiment, body, collider))
    n_solved = experiment.report.frames
    with context.progress(
        len(evenly_spaced(contact, n_solved)), unit="frames", desc=f"{scene.name}: full-space solves"
    ) as progress:

        def solve(frame: int) -> FrameSolves:
            full_x, pose = motion.positions(frame), motion.poses[frame]
            solves = store.load(frame, full_x, pose) if context.resume else None
            if solves is not None:
                progress.skip(1)
                return solves
            solves = solve_frame(
                problem, comparer.rows(frame), comparer.reduced(frame), full_x, collider, pose
            )
            store.save(frame, full_x, pose, solves)
            progress.update()
            return solves

        return JudgedScene(scene.name, comparer, compare(comparer, contact, press, solve, n_solved), motions)


def _collider(experiment: Experiment, scene: SceneSpec) -> Collider:
    """The one collider of a test scene."""
    return scene_parts(experiment, scene).colliders[0].collider


def _corrections(files: RunFiles, body: ReducedBody, collider: Collider) -> dict[str, Corrected]:
    """Every correction of the run directory."""
    return {
        name: Corrected.of(load_correction(path, body, collider), body)
        for name, path in files.corrections.items()
    }


def _solve_context(experiment: Experiment, body: ReducedBody, collider: Collider) -> str:
    """Names everything besides the frame that decides a full-space solve. The collider is named by its
    distance at points around it, so that a changed mesh file is noticed too."""
    probes = np.random.default_rng(0).uniform(1.5 * collider.lower, 1.5 * collider.upper, (64, collider.dim))
    problem = {
        "gravity": experiment.dynamics.gravity,
        "stiffness": experiment.contact.stiffness,
        "collider": experiment.collider(collider.name).model_dump(mode="json"),
    }
    return content_hash(
        {
            "body": body.content_hash,
            "problem": json.dumps(problem, sort_keys=True),
            "distance": collider.sdf(probes),
        }
    )


def _judged_model(experiment: Experiment, files: RunFiles) -> str | None:
    """The correction that the report is about: `[report] model` if it is there, else the last by name."""
    if experiment.report.model in files.corrections:
        return experiment.report.model
    return max(files.corrections, default=None)


def _contact_notes(scenes: list[JudgedScene]) -> list[str]:
    return [
        f"In the scene \u201c{scene.name}\u201d the body never touches the collider, "
        "so there is no error to report: change its keyframes."
        for scene in scenes
        if scene.comparison is None
    ]


def _renderer(scene: JudgedScene) -> Renderer:
    comparer, poses = scene.comparer, scene.comparer.motion.poses
    return make_renderer(comparer.body.mesh, comparer.collider, poses[len(poses) // 2])
