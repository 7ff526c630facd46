"""Pictures are complete and transparent, with and without GL."""

import io
import subprocess

import numpy as np
import pytest

pytest.importorskip("matplotlib")
pytest.importorskip("pyvista")

from PIL import Image

from softprint.fem_truth.report.drawing import renderings
from softprint.fem_truth.report.drawing.flat_renderings import FlatRenderer
from softprint.fem_truth.report.drawing.renderings import GlRenderer, gl_problem, make_renderer
from softprint.runtime.colliders import Sphere
from softprint.runtime.colliders.pose import RigidPose


@pytest.fixture
def scene(jelly_body):
    """Body, collider, and its pose with the lowest point 10 mm below the middle of the body's top."""
    body = jelly_body
    collider = Sphere(0.02, body.dim)
    top = np.zeros(body.dim)
    top[-1] = body.mesh.points[:, -1].max()
    pose = RigidPose(np.eye(body.dim), top + 0.01 * np.eye(body.dim)[-1])
    return body, collider, pose, top


def pixels(picture):
    image = Image.open(io.BytesIO(picture.data))
    assert image.size == (picture.width, picture.height)
    return np.asarray(image.convert("RGBA")).astype(int)


def all_views(renderer, scene):
    body, _, pose, top = scene
    x = body.mesh.points
    heat = renderer.heat(x, np.linspace(0, 1, len(x)), 1.0, "heat")
    return renderer.outside(x, pose, "outside"), renderer.cut(x, pose, top, "cut"), heat


def test_flat_pictures(scene):
    body, collider, *_ = scene
    outside, cut, heat = all_views(FlatRenderer(body.mesh, collider, "flat"), scene)
    assert (cut is None) == (body.dim == 3)
    for picture in filter(None, (outside, cut, heat)):
        opacity = pixels(picture)[..., 3]
        assert opacity.min() == 0  # the page shows through
        assert 0.1 < np.mean(opacity > 0) < 0.95  # and there is something to see
    assert outside.alt == "outside"
    assert outside.uri.startswith("data:image/webp;base64,")


def test_a_picture_follows_the_positions(scene):
    body, collider, pose, _ = scene
    renderer = FlatRenderer(body.mesh, collider, "flat")
    x = body.mesh.points
    pressed = x.copy()
    pressed[:, -1] *= 0.8
    first, second = (pixels(renderer.outside(p, pose, "")) for p in (x, pressed))
    assert np.abs(first - second).max() > 100


def test_pictures_by_gl(jelly3d_body):
    if gl_problem():
        pytest.skip("off-screen OpenGL does not work here")
    body = jelly3d_body
    collider = Sphere(0.02, 3)
    scene = (body, collider, RigidPose(np.eye(3), np.array([0, 0, 0.07])), np.array([0, 0, 0.06]))
    renderer = make_renderer(body.mesh, collider, scene[2])
    assert isinstance(renderer, GlRenderer)
    for picture in all_views(renderer, scene):
        opacity = pixels(picture)[..., 3]
        assert opacity.min() == 0
        assert 0.1 < np.mean(opacity > 0) < 0.95


def test_a_picture_does_not_depend_on_those_before(jelly3d_body):
    """All are drawn in one window, one after the other."""
    if gl_problem():
        pytest.skip("off-screen OpenGL does not work here")
    scene = (jelly3d_body, None, RigidPose(np.eye(3), np.array([0, 0, 0.07])), np.array([0, 0, 0.06]))
    renderings._plotter.cache_clear()
    first = all_views(GlRenderer(jelly3d_body.mesh, Sphere(0.02, 3)), scene)
    all_views(GlRenderer(jelly3d_body.mesh, Sphere(0.03, 3), from_above=False), scene)
    again = all_views(GlRenderer(jelly3d_body.mesh, Sphere(0.02, 3)), scene)
    assert [picture.data for picture in again] == [picture.data for picture in first]


def test_a_contact_at_the_rim_is_cut_through_the_body(jelly3d_body):
    """Of several models at one contact, some do not reach as far: through the contact, a plane misses their bodies, and
    it may miss the collider, too."""
    if gl_problem():
        pytest.skip("off-screen OpenGL does not work here")
    x, pose = jelly3d_body.mesh.points, RigidPose(np.eye(3), np.array([0, 0, 0.07]))
    renderer = GlRenderer(jelly3d_body.mesh, Sphere(0.02, 3))
    for axis in renderings._GRID_AXES.T:
        for side in (x @ axis).min(), (x @ axis).max():
            cut = renderer.cut(x, pose, 1.1 * side * axis, "cut")
            assert np.mean(pixels(cut)[..., 3] > 0) > 0.05, (axis, side)


def test_without_gl_the_report_says_so_and_still_draws(jelly3d_body, monkeypatch):
    failed = subprocess.CompletedProcess(
        [], -6, "", "some text\nlibEGL.so.1: cannot open shared object file\n"
    )
    monkeypatch.setattr(renderings.subprocess, "run", lambda *args, **kwargs: failed)
    monkeypatch.setattr(renderings, "gl_problem", gl_problem.__wrapped__)  # not what was found before
    renderer = make_renderer(jelly3d_body.mesh, Sphere(0.02, 3), RigidPose.identity(3))
    assert isinstance(renderer, FlatRenderer)
    assert "libEGL.so.1: cannot open" in renderer.description
    assert "libegl1" in renderer.description


def test_a_collider_below_is_drawn_from_below(jelly3d_body):
    """A ball at the body's lower or upper face; from the other side it would be hidden by the body."""
    if gl_problem():
        pytest.skip("off-screen OpenGL does not work here")
    mesh, ball = jelly3d_body.mesh, Sphere(0.02, 3)
    for z in (mesh.points[:, 2].min(), mesh.points[:, 2].max()):
        pose = RigidPose(np.eye(3), np.array([0.0, 0.0, z]))
        chosen = make_renderer(mesh, ball, pose)
        other = GlRenderer(mesh, ball, from_above=z == mesh.points[:, 2].min())
        seen, hidden = (pixels(of.outside(mesh.points, pose, "")).astype(float) for of in (chosen, other))
        # The collider takes the red out of the body behind it, which alone has 49 more of it than of blue, and more.
        blue, hidden_blue = (((p[..., 2] > p[..., 0] - 40) & (p[..., 3] > 200)).sum() for p in (seen, hidden))
        assert blue > 3 * hidden_blue
