"""The work of `softprint report`: read the run directory, evaluate the models, draw, and write both files."""

from __future__ import annotations

import json
from contextlib import ExitStack
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from softprint.fem_truth.elasticity.full_space_elasticity import FullSpaceElasticity
from softprint.fem_truth.report.assemble import JudgedScene, ReportInputs, assemble
from softprint.fem_truth.report.drawing.picture import Renderer
from softprint.fem_truth.report.drawing.renderings import make_renderer
from softprint.fem_truth.report.made_report import NUMBERS, PAGE, MadeReport, report_inputs
from softprint.fem_truth.report.measurements.body_alone import InternalDisplacement, NoCollider, WithInternal
from softprint.fem_truth.report.measurements.comparison import evenly_spaced
from softprint.fem_truth.report.measurements.held_out import (
    Comparer,
    HeldOutMotion,
    StateCorrection,
    compare,
)
from softprint.fem_truth.report.measurements.learning import load_learning
from softprint.fem_truth.report.measurements.solves import FrameSolves, SolveStore, solve_frame
from softprint.fem_truth.report.page import render_page
from softprint.fem_truth.report.report_json import json_text, write_text
from softprint.fem_truth.report.run_files import (
    RunFiles,
    find_run_files,
    judged_scenes,
    load_motions,
    missing_notes,
    used_paths,
)
from softprint.fem_truth.report.scene_notes import scene_note
from softprint.fem_truth.report.shapes import judge_shapes
from softprint.fem_truth.statics.constrained import ConstrainedProblem
from softprint.runtime.body.body import ReducedBody
from softprint.runtime.cli.run_body import body_of_run
from softprint.runtime.colliders.collider import Collider
from softprint.runtime.colliders.pose import RigidPose
from softprint.runtime.contact import PenaltyContact
from softprint.runtime.contact.intrusion import pierced_from
from softprint.runtime.contact.penalty import CONTACT_VERSION
from softprint.runtime.errors import SoftprintError
from softprint.runtime.experiment.experiment import CONDENSED, FULL
from softprint.runtime.io.files import content_hash
from softprint.runtime.learned.correction_file import read_correction
from softprint.runtime.learned.internal.file import load_internal
from softprint.runtime.learned.internal_correction import internal_correction
from softprint.runtime.learned.static_correction import StaticCorrection
from softprint.runtime.mechanics.compliance.null_space_compliance import NullSpaceCompliance
from softprint.runtime.mechanics.static_condensation import compute_static_condensation
from softprint.runtime.scenes.corrected_body import CorrectedBody, on_corrected_body
from softprint.runtime.scenes.model_name import ModelName
from softprint.runtime.scenes.scene import scene_parts
from softprint.runtime.truth.truth_file import load_truth

if TYPE_CHECKING:
    from softprint.runtime.cli.context import Context
    from softprint.runtime.experiment import Experiment, SceneSpec


def make_report(context: Context, pictures: bool = True) -> MadeReport:
    """Evaluate every suitable scene with role `test`, and write report.html and report.json in the run directory."""
    experiment, folder = context.experiment, context.out_dir
    made_from = report_inputs(context, pictures)
    files = find_run_files(folder, experiment)
    body = body_of_run(context)
    scenes = [judge_scene(context, files, body, scene) for scene in judged_scenes(experiment)]
    with ExitStack() as stack:
        truth = None if files.truth is None else stack.enter_context(load_truth(files.truth, body))
        model = _judged_model(experiment, files)
        inputs = ReportInputs(
            experiment=experiment,
            body=body,
            scenes=scenes,
            truth=truth,
            learning=load_learning(files.corrections, folder, files.internal),
            model=model,
            folder=folder,
            files=used_paths(files, judged_scenes(experiment)),
            notes=[*missing_notes(files, experiment), *_scene_notes(scenes)],
            shapes=None if truth is None else judge_shapes(context, files, body, truth, model, pictures),
        )
        context.say("drawing")
        with context.stage("drawing"):
            content = assemble(inputs, _renderer if pictures else None)
    html = render_page(content)  # before anything is written, so that either both files change or none
    write_text(folder / NUMBERS, json_text({**content.summary, "inputs": made_from}))
    write_text(folder / PAGE, html)
    return MadeReport.of(folder, content.summary)


def judge_scene(context: Context, files: RunFiles, body: ReducedBody, scene: SceneSpec) -> JudgedScene:
    """Compare all models on one test scene; full-space solves of an earlier run are read from its files."""
    experiment = context.experiment
    with context.stage(f"{scene.name}: reading motions"):
        motions = load_motions(files, experiment, scene, body)
        collider = _collider(experiment, scene)
        corrections = state_corrections(experiment, files, body, collider)
    full = motions[FULL]
    alone = isinstance(collider, NoCollider)
    still = [RigidPose.identity(body.dim)] * full.n_frames
    # Several models in a row read the same frame: cache the last ones.
    motion = HeldOutMotion(
        full.times,
        still if alone else full.colliders[collider.name].poses,
        full.in_contact,
        lru_cache(maxsize=4)(full.positions),
    )
    comparer = Comparer(body, collider, motion, corrections)
    contact, depth = comparer.contact_frames()
    valid = ~full.invalid(pierced_from(body.mesh))[contact]
    left_out = int(np.count_nonzero(~valid))
    contact, depth = contact[valid], depth[valid]
    if not len(contact):
        return JudgedScene(scene.name, comparer, None, motions, left_out)
    if alone:
        comparison = compare(comparer, contact, depth, _no_solve, 0)
        return JudgedScene(scene.name, comparer, comparison, motions, left_out)

    with context.stage("preparing full space"):
        elasticity = FullSpaceElasticity(body)
    problem = ConstrainedProblem(
        elasticity,
        np.array(experiment.dynamics.gravity),
        PenaltyContact.of(experiment.contact),
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

        comparison = compare(comparer, contact, depth, solve, n_solved)
    return JudgedScene(scene.name, comparer, comparison, motions, left_out)


def _collider(experiment: Experiment, scene: SceneSpec) -> Collider:
    """The one collider of a test scene, or what stands for it."""
    placed = scene_parts(experiment, scene).colliders
    return placed[0].collider if placed else NoCollider(experiment.dim)


def _no_solve(frame: int) -> FrameSolves:
    raise AssertionError("without a collider no frame is solved")


def state_corrections(
    experiment: Experiment, files: RunFiles, body: ReducedBody, collider: Collider
) -> dict[str, StateCorrection]:
    """Every correction of the run directory, and static condensation beside internal ones."""
    trained = {name: read_correction(path, body) for name, path in files.corrections.items()}
    if isinstance(collider, NoCollider):
        trained = {}
    internals: dict[str, InternalDisplacement] = {}
    if files.internal or any(own.header.added_to for own in trained.values()):
        internals = _internal_displacements(experiment, files, body)
    found: dict[str, StateCorrection] = {}
    for name in [*trained, *(files.joint if trained else ())]:
        named = ModelName.of(name)
        own = trained[named.correction]
        made, below = own.on(collider), named.below(own.header.added_to)
        if not below:
            found[name] = StaticCorrection(made, body)
            continue
        if below not in internals:
            raise SoftprintError(
                f"{files.corrections[named.correction]}: is added to the internal correction {below!r}, which is "
                "missing"
            )
        without = internals[below]
        if named.internal:
            made = on_corrected_body(made, CorrectedBody(body, internal=without.internal))
        found[name] = WithInternal(StaticCorrection(made, body, internal=without.internal), without)
    return {**found, **(internals if files.internal else {})}


def _internal_displacements(
    experiment: Experiment, files: RunFiles, body: ReducedBody
) -> dict[str, InternalDisplacement]:
    """Every internal correction of the run directory, and static condensation beside them."""
    condensation = compute_static_condensation(body, experiment.dynamics.gravity, NullSpaceCompliance(body))
    found = {CONDENSED: InternalDisplacement(body, condensation, None)}
    for name, path in files.internal.items():
        internal = internal_correction(load_internal(path, body), body, experiment.dynamics.gravity)
        own = condensation if internal.on_condensation else None
        found[name] = InternalDisplacement(body, own, internal)
    return found


def _solve_context(experiment: Experiment, body: ReducedBody, collider: Collider) -> str:
    """Identifies everything besides the frame that determines a full-space solve. The collider is identified by its
    signed distance at points around it, so that a changed mesh file is noticed too."""
    around = np.array([collider.lower, collider.upper])
    if not np.isfinite(around).all():  # a plane: where the body is
        around = np.array([body.mesh.points.min(axis=0), body.mesh.points.max(axis=0)])
    probes = np.random.default_rng(0).uniform(1.5 * around[0], 1.5 * around[1], (64, collider.dim))
    problem = {
        "gravity": experiment.dynamics.gravity,
        "stiffness": experiment.contact.stiffness,
        "refinement": experiment.contact.refinement,
        "version": CONTACT_VERSION,
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
    """The correction that the report is about: `[report] model` if it is trained, otherwise the last by name. Raises
    SoftprintError where the experiment asks for one that is not trained, and others are."""
    asked = experiment.report.model
    if asked in files.trained:
        return asked
    if files.trained and "model" in experiment.report.model_fields_set:
        raise SoftprintError(
            f"{experiment.path}: [report.model] {asked!r} is not trained; there are {', '.join(sorted(files.trained))}"
        )
    return max(files.trained, default=None)


def _scene_notes(scenes: list[JudgedScene]) -> list[str]:
    notes = (scene_note(scene.name, scene.comparison, scene.n_left_out) for scene in scenes)
    return [note for note in notes if note]


def _renderer(scene: JudgedScene) -> Renderer:
    comparer, poses = scene.comparer, scene.comparer.motion.poses
    corners = None
    if isinstance(comparer.collider, NoCollider):
        # A body that is led is stretched and moved out of its place.
        places = [comparer.motion.positions(frame) for frame in range(comparer.motion.n_frames)]
        corners = np.array(
            [np.min([x.min(axis=0) for x in places], axis=0), np.max([x.max(axis=0) for x in places], axis=0)]
        )
    return make_renderer(comparer.body.mesh, comparer.collider, poses[len(poses) // 2], corners)
