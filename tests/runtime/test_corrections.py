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

from runtime.body import ReducedBody
from runtime.colliders import Box, RigidPose, Sphere
from runtime.errors import SoftprintError
from runtime.learned.contact_patch import ContactProbe
from runtime.learned.correction_file import load_correction, save_correction
from runtime.learned.force.correction import ForceCorrection
from runtime.learned.force.model import ForceModel, ForceModelOptions
from runtime.learned.thesis5.correction import ContactCentricCorrection
from runtime.learned.thesis5.model import ContactCentricModel, ContactCentricOptions
from runtime.learned.thesis6.correction import DescriptorCorrection
from runtime.learned.thesis6.model import DescriptorModel, DescriptorModelOptions
from runtime.mechanics.body_mechanics import BodyMechanics, compute_mechanics
from tests.altered import alter_tensors

STIFFNESS = 1e9
# Central differences in float64 with a step of 1e-6 leave about (1e-6)^2 of curvature over millimetres and
# 1e-16 / 1e-6 of round-off: 1e-6 relative covers both.
DIFFERENCES = 1e-6

FORMS = ("thesis", "geometry", "descriptor", "loads", "internal")
FIELDS = ("thesis", "geometry", "descriptor")


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
    if form in ("loads", "internal"):
        if body.name not in mechanics:
            mechanics[body.name] = compute_mechanics(body, 200, internal=True)
        compliance, internal = mechanics[body.name]
        if double:
            modes, weight = internal.modes.astype(np.float64), internal.weight.astype(np.float64)
            internal = replace(internal, modes=modes, weight=weight)
        options = ForceModelOptions((16, 12), "silu", 5e-4, 4e-3, STIFFNESS)
        load_model = ForceModel(options, dim, body.n_rows)
        random_weights(load_model, 1)
        load_model.local_scale.fill_(0.5)
        load_model.traction_scale.fill_(300.0)
        load_model = load_model.double() if double else load_model
        own = BodyMechanics(compliance, internal if form == "internal" else None)
        return ForceCorrection(form, load_model, body, collider, own)
    if form == "descriptor":
        descriptor_options = DescriptorModelOptions((16, 12), "elu", 0.03, 4, "all", 5e-4)
        descriptor_model = DescriptorModel(descriptor_options, dim, body.n_rows)
        random_weights(descriptor_model, 3)
        descriptor_model.scale.fill_(0.03)
        descriptor_model.output_scale.fill_(1e-3)
        descriptor_model = descriptor_model.double() if double else descriptor_model
        return DescriptorCorrection(form, descriptor_model, body, collider)
    thesis = form == "thesis"
    field_options = ContactCentricOptions(
        encoding="weighted_rows" if thesis else "local_geometry",
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
    """The ball of 2 cm pressed into the top of the block."""
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
def test_turns_with_body_and_collider(form, jelly_body, mechanics):
    body, dim = jelly_body, jelly_body.dim
    bound = make_correction(form, body, mechanics).bind(body.node_points())
    rows, pose = bent_rows(body), pressed_pose(body)
    motion = RigidPose.from_rotation_vector(
        [1.1] if dim == 2 else [0.8, -0.3, 0.5], np.linspace(0.1, 0.3, dim)
    )
    # Rows are [points; R^T; t]: points and t move with the motion, the linear rows are only rotated.
    positions = np.ones(body.n_rows)
    positions[body.handles.n_points : -1] = 0.0
    moved = rows @ motion.rotation.T + positions[:, None] * motion.translation
    u = bound.displacement(rows, pose)
    assert np.allclose(body.reduced_positions(moved), motion.apply(body.reduced_positions(rows)), atol=1e-12)
    # 1e-12 m: round-off of coordinates of decimetres, amplified by the network; modes of internal response are rounded
    # to float32 and annihilate translations to 1e-7 of their size; loads are in balance to 1e-6 of the depth of 6 mm,
    # from a start that depends on the state before.
    tolerance = {"internal": 1e-6, "loads": 1e-8}.get(form, 1e-12)
    assert np.allclose(bound.displacement(moved, motion.compose(pose)), motion.rotate(u), atol=tolerance)


@pytest.mark.parametrize("form", FORMS)
def test_fades_out_as_contact_opens(form, jelly_body, mechanics):
    bound = make_correction(form, jelly_body, mechanics).bind(jelly_body.node_points())
    rows, pose, ball = jelly_body.rest_rows, pressed_pose(jelly_body), Sphere(0.02, jelly_body.dim)
    surface = jelly_body.mesh.points[jelly_body.surface.nodes]

    def lifted(height: float) -> RigidPose:
        return RigidPose(pose.rotation, pose.translation + height * np.eye(jelly_body.dim)[-1])

    def depth(height: float) -> float:
        return -float(ball.sdf(lifted(height).apply_inverse(surface)).min())

    def size(left: float) -> float:
        height = brentq(lambda h: depth(h) - left, -0.01, 0.02)
        return float(np.abs(bound.displacement(rows, lifted(height))).max())

    # The field falls at least as fast as the depth; from 4 mm to 10 um that is by 400.
    assert size(4e-3) > 0.0
    assert size(1e-5) < 1e-2 * size(4e-3)
    assert size(-2e-3) == 0.0
    assert not bound.displacement(rows, lifted(1.0)).any()
    if form in FIELDS:
        assert len(bound.linearise(rows, lifted(1.0)).index) == 0


def test_patch_depth_is_the_depth_of_a_flat_press(jelly_body):
    """A wide plate pressed flat into the top: every sample below it is equally deep."""
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
    own = correction.mechanics if isinstance(correction, ForceCorrection) else None
    save_correction(path, form, correction.model, body, "ball", "0" * 64, 0.5, {"seed": 1}, own)
    return path


@pytest.mark.parametrize("form", FORMS)
def test_file_round_trip(form, jelly2d_body, mechanics, tmp_path):
    body = jelly2d_body
    path = written(tmp_path, form, body, mechanics)
    loaded = load_correction(path, body, Sphere(0.02, 2, name="ball"))
    rows, pose = bent_rows(body), pressed_pose(body)
    before = (
        make_correction(form, body, mechanics, double=False).bind(body.node_points()).displacement(rows, pose)
    )
    after = loaded.bind(body.node_points()).displacement(rows, pose)
    # Weights come back exactly; the compliance is kept in half precision, 2^-11.
    assert (
        np.abs(after - before).max()
        <= (1e-3 if form in ("loads", "internal") else 0.0) * np.abs(before).max()
    )
    assert [file.name for file in tmp_path.iterdir()] == [path.name]


def test_bad_files_are_refused(jelly2d_body, jelly3d_body, mechanics, tmp_path):
    ball = Sphere(0.02, 2, name="ball")
    path = written(tmp_path, "thesis", jelly2d_body, mechanics)
    with pytest.raises(SoftprintError, match="another body"):
        load_correction(path, jelly3d_body, ball)
    with pytest.raises(SoftprintError, match="trained for the collider 'ball'"):
        load_correction(path, jelly2d_body, Sphere(0.02, 2, name="other"))
    with pytest.raises(SoftprintError, match="no such correction"):
        load_correction(tmp_path / "absent.safetensors", jelly2d_body, ball)
    truncated = tmp_path / "truncated.safetensors"
    truncated.write_bytes(path.read_bytes()[:-100])
    with pytest.raises(SoftprintError, match="correction file is damaged"):
        load_correction(truncated, jelly2d_body, ball)
    other = tmp_path / "other.safetensors"
    for change, complaint in (
        ({"softprint_version": "99"}, "version 99"),
        ({"softprint_kind": "recipe"}, "not a correction"),
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
    """Like every other file of a run: the rights that the user's mask gives."""
    plain = tmp_path / "plain"
    plain.write_text("")
    assert written(tmp_path, "thesis", jelly2d_body, mechanics).stat().st_mode == plain.stat().st_mode
