"""Corrections: derivatives against finite differences, invariance, fading contact, and their files."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from scipy.optimize import brentq

from softprint.runtime.body import ReducedBody
from softprint.runtime.colliders import Box, RigidPose, Sphere
from softprint.runtime.colliders.shape_samples import shape_samples
from softprint.runtime.contact import PenaltyContact
from softprint.runtime.dynamics import PlacedCollider, Simulator
from softprint.runtime.errors import SoftprintError
from softprint.runtime.learned.contact_patch import ContactProbe
from softprint.runtime.learned.correction_file import load_correction, save_correction
from softprint.runtime.learned.force.correction import ForceCorrection
from softprint.runtime.learned.force.model import ForceModel, ForceModelOptions
from softprint.runtime.learned.static_correction import StaticCorrection
from softprint.runtime.learned.thesis5.correction import ContactCentricCorrection
from softprint.runtime.learned.thesis5.model import ContactCentricModel, ContactCentricOptions
from softprint.runtime.learned.thesis6.correction import DescriptorCorrection
from softprint.runtime.learned.thesis6.model import DescriptorModel, DescriptorModelOptions
from softprint.runtime.mechanics.body_mechanics import BodyMechanics, compute_mechanics
from softprint.runtime.mechanics.mechanics_file import mechanics_path, save_mechanics
from tests.bad_input.altered import alter_tensors

STIFFNESS = 1e9
# Central differences in float64 with a step of 1e-6 leave about (1e-6)^2 of curvature over millimetres and
# 1e-16 / 1e-6 of round-off: 1e-6 relative covers both.
DIFFERENCES = 1e-6

# Inputs of the thesis's form, sparse and dense (eqs. 5.4 and 5.3).
ENCODINGS = {"thesis": "weighted_rows", "dense": "all_rows"}
FIELDS = (*ENCODINGS, "geometry", "descriptor")
# Contact forces, without and with static condensation.
FORCES = ("force", "condensed")
FORMS = FIELDS + FORCES


@pytest.fixture(scope="module")
def mechanics() -> dict[str, BodyMechanics]:
    return {}


def random_weights(model: torch.nn.Module, seed: int) -> None:
    generator = torch.Generator().manual_seed(seed)
    for parameter in model.parameters():
        parameter.data = 0.4 * torch.randn(parameter.shape, generator=generator, dtype=parameter.dtype)


def make_correction(
    form: str, body: ReducedBody, mechanics: dict[str, BodyMechanics], double: bool = True
) -> ContactCentricCorrection | ForceCorrection | DescriptorCorrection:
    """A correction with random weights and a displacement of about a millimetre."""
    dim, collider = body.dim, Sphere(0.02, body.dim, name="ball")
    if form in FORCES:
        if body.name not in mechanics:
            mechanics[body.name] = compute_mechanics(body, 200, condensation=True)
        compliance, condensation, spread, _ = mechanics[body.name]
        if double:
            modes, weight = condensation.modes.astype(np.float64), condensation.weight.astype(np.float64)
            condensation = replace(condensation, modes=modes, weight=weight)
        options = ForceModelOptions((16, 12), "silu", 5e-4, 4e-3, STIFFNESS)
        force_model = ForceModel(options, dim, body.n_rows)
        random_weights(force_model, 1)
        force_model.local_scale.fill_(0.5)
        force_model.traction_scale.fill_(300.0)
        force_model = force_model.double() if double else force_model
        own = BodyMechanics(compliance, condensation if form == "condensed" else None, spread)
        return ForceCorrection(form, force_model, body, collider, own)
    if form == "descriptor":
        descriptor_options = DescriptorModelOptions((16, 12), "elu", 0.03, 4, "all", 5e-4)
        descriptor_model = DescriptorModel(descriptor_options, dim, body.n_rows)
        random_weights(descriptor_model, 3)
        descriptor_model.scale.fill_(0.03)
        descriptor_model.output_scale.fill_(1e-3)
        descriptor_model = descriptor_model.double() if double else descriptor_model
        return DescriptorCorrection(form, descriptor_model, body, collider)
    thesis = form in ENCODINGS
    field_options = ContactCentricOptions(
        encoding=ENCODINGS.get(form, "local_geometry"),
        patch_inputs=not thesis,
        widths=(16, 12),
        activation="tanh" if thesis else "softplus",
        fade="saturating" if thesis else "proportional",
        fade_depth=5e-4,
    )
    model = ContactCentricModel(field_options, dim, body.n_rows)
    random_weights(model, 2)
    model.local_scale.fill_(0.5)
    model.shared_scale.fill_(0.5)
    model.output_scale.fill_(1e-3 if thesis else 1e-4)
    return ContactCentricCorrection(form, model.double() if double else model, body, collider)


def pressed_pose(body: ReducedBody, depth: float = 0.006) -> RigidPose:
    """The pose of the ball of 2 cm inside the top of the block."""
    top = float(body.mesh.points[:, -1].max())
    centre = np.full(body.dim, 0.004)
    centre[-1] = top + 0.02 - depth
    return RigidPose.from_rotation_vector([0.7] if body.dim == 2 else [0.3, -0.5, 0.4], centre)


def bent_rows(body: ReducedBody) -> np.ndarray:
    rows = body.rest_rows.copy()
    points = body.handles.n_points
    rows[:points] += 0.002 * np.random.default_rng(3).standard_normal((points, body.dim))
    return rows


@pytest.mark.parametrize("form", FIELDS)
def test_jacobian_is_the_derivative(form, jelly_body, mechanics):
    bound = make_correction(form, jelly_body, mechanics).bind(jelly_body.node_points())
    rows, pose = bent_rows(jelly_body), pressed_pose(jelly_body)
    field = bound.linearise(rows, pose)
    assert np.allclose(field.displacement, bound.displacement(rows, pose)[field.index], rtol=0, atol=1e-15)
    assert np.abs(field.displacement).max() > 1e-5
    direction, step = np.random.default_rng(4).standard_normal(rows.shape), 1e-6
    difference = bound.displacement(rows + step * direction, pose) - bound.displacement(
        rows - step * direction, pose
    )
    by_hand = np.einsum("narb,rb->na", field.jacobian, direction)
    scale = np.abs(by_hand).max()
    assert np.abs(difference[field.index] / (2 * step) - by_hand).max() < DIFFERENCES * max(scale, 1.0)


@pytest.mark.parametrize("form", FORMS)
def test_rotates_with_body_and_collider(form, jelly_body, mechanics):
    body, dim = jelly_body, jelly_body.dim
    correction = StaticCorrection(make_correction(form, body, mechanics), body)
    rows, pose = bent_rows(body), pressed_pose(body)
    motion = RigidPose.from_rotation_vector(
        [1.1] if dim == 2 else [0.8, -0.3, 0.5], np.linspace(0.1, 0.3, dim)
    )
    # Rows are [points; R^T; t]: points and t move with the motion, the linear rows are only rotated.
    positions = np.ones(body.n_rows)
    positions[body.handles.n_points : -1] = 0.0
    moved = rows @ motion.rotation.T + positions[:, None] * motion.translation
    u = correction.displacement(rows, pose)
    assert np.allclose(body.reduced_positions(moved), motion.apply(body.reduced_positions(rows)), atol=1e-12)
    # 1e-12 m: round-off of coordinates of decimetres, amplified by the network; static condensation modes are
    # rounded to float32 and annihilate translations to 1e-7 of their size; contact forces are in balance to 1e-6 of the
    # depth of 6 mm.
    tolerance = {"condensed": 1e-6, "force": 1e-8}.get(form, 1e-12)
    assert np.allclose(correction.displacement(moved, motion.compose(pose)), motion.rotate(u), atol=tolerance)


@pytest.mark.parametrize("form", FORMS)
def test_fades_out_as_contact_opens(form, jelly_body, mechanics):
    made = make_correction(form, jelly_body, mechanics)
    correction = StaticCorrection(made, jelly_body)
    rows, pose, ball = jelly_body.rest_rows, pressed_pose(jelly_body), Sphere(0.02, jelly_body.dim)
    surface = jelly_body.mesh.points[jelly_body.surface.nodes]

    def lifted(height: float) -> RigidPose:
        return RigidPose(pose.rotation, pose.translation + height * np.eye(jelly_body.dim)[-1])

    def depth(height: float) -> float:
        if form in FORCES:  # felt between the nodes of the flat top, too
            return float(surface[:, -1].max() - lifted(height).translation[-1] + 0.02)
        return -float(ball.sdf(lifted(height).apply_inverse(surface)).min())

    def size(left: float) -> float:
        height = brentq(lambda h: depth(h) - left, -0.01, 0.02)
        return float(np.abs(correction.displacement(rows, lifted(height))).max())

    # The field decreases at least as fast as the depth, that is by a factor of 400 from 4 mm to 10 um.
    assert size(4e-3) > 0.0
    assert size(1e-5) < 1e-2 * size(4e-3)
    assert size(-2e-3) == 0.0
    assert not correction.displacement(rows, lifted(1.0)).any()
    if form in FIELDS:
        bound = made.bind(jelly_body.node_points())
        assert len(bound.linearise(rows, lifted(1.0)).index) == 0


def test_patch_depth_is_that_of_a_parallel_plate(jelly_body):
    """A wide plate parallel to the top: every sample below it is equally deep."""
    dim = jelly_body.dim
    plate = Box(np.full(dim, 0.2), rounding=0.01)
    centre = np.zeros(dim)
    centre[-1] = 0.06 + 0.2 - 0.003
    patch = ContactProbe(jelly_body, plate).measure(jelly_body.rest_rows, RigidPose(np.eye(dim), centre))
    assert patch is not None
    assert patch.depth == pytest.approx(
        0.003, rel=1e-6
    )  # the plate's distance is exact here, up to its rounding


def test_points_out_of_reach_are_inactive(jelly_body, mechanics):
    correction = make_correction("geometry", jelly_body, mechanics)
    rows, pose = jelly_body.rest_rows, pressed_pose(jelly_body)
    points = jelly_body.node_points()
    everywhere, near = correction.bind(points), correction.bind(points, reach=0.005)
    field = near.linearise(rows, pose)
    assert 0 < len(field.index) < len(points)
    assert np.allclose(field.displacement, everywhere.displacement(rows, pose)[field.index], atol=1e-15)
    assert np.allclose(field.jacobian, everywhere.linearise(rows, pose).jacobian[field.index], atol=1e-13)


def written(tmp_path: Path, form: str, body: ReducedBody, mechanics: dict[str, BodyMechanics]) -> Path:
    correction = make_correction(form, body, mechanics, double=False)
    path = tmp_path / f"{form}.safetensors"
    own = ""
    if isinstance(correction, ForceCorrection):
        own = save_mechanics(mechanics_path(tmp_path, 200), correction.mechanics, body, 200).content_hash
    shape = shape_samples(Sphere(0.02, body.dim))
    save_correction(path, form, correction.model, body, "ball", "0" * 64, 0.5, {"seed": 1}, own, shape)
    return path


@pytest.mark.parametrize("form", FORMS)
def test_file_round_trip(form, jelly2d_body, mechanics, tmp_path):
    body = jelly2d_body
    path = written(tmp_path, form, body, mechanics)
    loaded = load_correction(path, body, Sphere(0.02, 2, name="ball"))
    rows, pose = bent_rows(body), pressed_pose(body)
    made = make_correction(form, body, mechanics, double=False)
    before, after = (StaticCorrection(found, body).displacement(rows, pose) for found in (made, loaded))
    # Weights are exact after a round trip; the compliance is stored in half precision, 2^-11.
    tolerance = 1e-3 if form in FORCES else 0.0
    assert np.abs(after - before).max() <= tolerance * np.abs(before).max()
    beside = {"mechanics_200.safetensors"} if form in FORCES else set()
    assert {file.name for file in tmp_path.iterdir()} == {path.name} | beside


def test_another_shape_of_the_same_name_is_refused(jelly2d_body, mechanics, tmp_path):
    path = written(tmp_path, "thesis5", jelly2d_body, mechanics)
    with pytest.raises(SoftprintError, match=r"another shape or size than this one of the same name"):
        load_correction(path, jelly2d_body, Sphere(0.025, 2, name="ball"))


def test_a_collider_of_the_same_shape_may_have_another_name(jelly2d_body, mechanics, tmp_path):
    """Such as one of six pins that are all alike: its correction bears its name, and is the same."""
    path = written(tmp_path, "thesis", jelly2d_body, mechanics)
    pose, rows = pressed_pose(jelly2d_body), bent_rows(jelly2d_body)
    found = []
    for name in ("ball", "pin_3"):
        correction = load_correction(path, jelly2d_body, Sphere(0.02, 2, name=name))
        assert correction.collider == name
        found.append(correction.bind(jelly2d_body.node_points()).displacement(rows, pose))
    assert np.abs(found[0]).max() > 0
    np.testing.assert_array_equal(*found)


def test_mechanics_are_found_near_a_correction_or_given(jelly2d_body, mechanics, tmp_path):
    body, ball = jelly2d_body, Sphere(0.02, 2, name="ball")
    run = tmp_path / "run"
    (run / "corrections").mkdir(parents=True)
    path = written(run / "corrections", "condensed", body, mechanics)
    beside, of_run = mechanics_path(run / "corrections", 200), mechanics_path(run, 200)
    shutil.move(beside, of_run)
    loaded = load_correction(str(path), body, ball)
    assert isinstance(loaded, ForceCorrection)
    assert loaded.mechanics.condensation is not None
    own, other = loaded.mechanics, mechanics[body.name]._replace(condensation=None)
    save_mechanics(mechanics_path(run, 100), other, body, 100)
    assert isinstance(load_correction(path, body, ball), ForceCorrection)  # the one of the right hash, of two
    of_run.unlink()
    with pytest.raises(
        SoftprintError, match=r"trained with other mechanics .*mechanics_100\.safetensors: copy the"
    ):
        load_correction(path, body, ball)
    mechanics_path(run, 100).unlink()
    with pytest.raises(SoftprintError, match=r"there is no mechanics file .* `softprint mechanics`"):
        load_correction(path, body, ball)
    given = load_correction(path, body, ball, own)
    assert isinstance(given, ForceCorrection)
    assert given.mechanics is own
    with pytest.raises(SoftprintError, match=r"other mechanics of the body .* than those given"):
        load_correction(path, body, ball, other)


def test_a_model_without_static_condensation_takes_none_of_the_file(jelly2d_body, mechanics, tmp_path):
    body, ball = jelly2d_body, Sphere(0.02, 2, name="ball")
    options = ForceModelOptions((4,), "silu", 5e-4, 4e-3, STIFFNESS, static_condensation=False)
    make_correction("condensed", body, mechanics)
    header = save_mechanics(mechanics_path(tmp_path, 200), mechanics[body.name], body)
    path, model = tmp_path / "plain.safetensors", ForceModel(options, 2, body.n_rows)
    save_correction(path, "plain", model, body, "ball", "", 0.5, {}, header.content_hash)
    loaded = load_correction(path, body, ball)
    assert isinstance(loaded, ForceCorrection)
    assert loaded.mechanics.condensation is None


def test_a_force_correction_takes_its_own_mechanics_and_stiffness(jelly2d_body, mechanics):
    body = jelly2d_body
    correction = make_correction("condensed", body, mechanics)
    placed = [PlacedCollider("ball", Sphere(0.02, 2, name="ball"), correction=correction)]
    contact = PenaltyContact(STIFFNESS)
    for other in (None, BodyMechanics(None, None), compute_mechanics(body, 20, condensation=False)):
        with pytest.raises(
            SoftprintError, match=r"give Simulator\(mechanics=\.\.\.\) those that it was trained"
        ):
            Simulator(body, placed, contact=contact, mechanics=other)
    with pytest.raises(
        SoftprintError, match=r"stiffness of 1e\+09 N/m\^4, not for 2e\+09: give PenaltyContact"
    ):
        Simulator(body, placed, contact=PenaltyContact(2 * STIFFNESS), mechanics=correction.mechanics)
    Simulator(body, placed, contact=contact, mechanics=correction.mechanics)


def test_bad_files_are_refused(jelly2d_body, jelly3d_body, mechanics, tmp_path):
    ball = Sphere(0.02, 2, name="ball")
    path = written(tmp_path, "thesis", jelly2d_body, mechanics)
    with pytest.raises(SoftprintError, match="another body"):
        load_correction(path, jelly3d_body, ball)
    with pytest.raises(SoftprintError, match="trained for the collider 'ball'"):
        load_correction(path, jelly2d_body, Sphere(0.021, 2, name="other"))
    with pytest.raises(SoftprintError, match="no such correction"):
        load_correction(tmp_path / "absent.safetensors", jelly2d_body, ball)
    truncated = tmp_path / "truncated.safetensors"
    truncated.write_bytes(path.read_bytes()[:-100])
    with pytest.raises(SoftprintError, match="correction file is damaged"):
        load_correction(truncated, jelly2d_body, ball)
    other = tmp_path / "other.safetensors"
    for change, complaint in (
        ({"softprint_version": "99"}, "version 99"),
        ({"softprint_kind": "recipe"}, "no correction"),
        ({"header": json.dumps({"name": "x"})}, "header is incomplete"),
    ):
        shutil.copy(path, other)
        alter_tensors(other, change)
        with pytest.raises(SoftprintError, match=complaint):
            load_correction(other, jelly2d_body, ball)
    shutil.copy(path, other)
    alter_tensors(other, {}, dropped=1)
    with pytest.raises(SoftprintError, match="do not fit together"):
        load_correction(other, jelly2d_body, ball)


def test_a_correction_may_be_read_by_those_who_may_read_a_run(tmp_path, jelly2d_body, mechanics):
    """Like every other file of a run, it has the permissions of the user's umask."""
    plain = tmp_path / "plain"
    plain.write_text("")
    assert written(tmp_path, "thesis", jelly2d_body, mechanics).stat().st_mode == plain.stat().st_mode
