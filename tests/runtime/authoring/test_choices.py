"""What `softprint new` chooses and measures: against closed forms, scaled bodies and known distances."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from softprint.runtime.authoring.body_source import Placing, placed
from softprint.runtime.authoring.choose_settings import (
    DENSITY,
    GRAVITY,
    POISSON,
    choose_settings,
    hold_box,
    rounded_up,
    thicknesses,
)
from softprint.runtime.authoring.fidelity import fidelity
from softprint.runtime.authoring.fill_child import CLOSE, of_wanted_number
from softprint.runtime.authoring.fill_outline import filled_outline
from softprint.runtime.authoring.outline import read_outline
from softprint.runtime.authoring.pieces import largest_piece
from softprint.runtime.authoring.probe_scenes import keyframes, probe_scenes, surface_points
from softprint.runtime.body.placement import in_box
from softprint.runtime.colliders import KeyframedPath, Sphere
from softprint.runtime.errors import SoftprintError
from softprint.runtime.mechanics.rest_response import RestResponse
from softprint.runtime.mesh import Mesh, box_mesh


def block(dim: int, size: float = 1.0) -> Mesh:
    """0.1 x (0.08 x) 0.06 m, on the ground."""
    if dim == 2:
        return box_mesh([-0.05 * size, 0.0], [0.05 * size, 0.06 * size], [20, 12])
    return box_mesh([-0.05 * size, -0.04 * size, 0.0], [0.05 * size, 0.04 * size, 0.06 * size], [8, 7, 6])


def test_a_column_sags_as_in_textbooks():
    height, young = 0.2, 5e3
    mesh = box_mesh([0.0, 0.0, 0.0], [0.02, 0.02, height], [3, 3, 20])
    held = np.flatnonzero(mesh.points[:, 2] == 0.0)
    expected = DENSITY * GRAVITY * height**2 / (2.0 * young)
    # What is held cannot widen, which stiffens the lowest tenth of the column.
    assert RestResponse(mesh, held, POISSON).sag(GRAVITY * DENSITY) / young == pytest.approx(
        expected, rel=0.04
    )


def test_a_cantilever_gives_way_as_in_textbooks_and_a_block_does_not():
    """A force F at the end of a slender beam of length L bends it by F L^3 / (3 E I)."""
    length, width = 0.2, 0.02
    beam = box_mesh([0.0, 0.0, 0.0], [length, width, width], [60, 6, 6])
    held = np.flatnonzero(beam.points[:, 0] == 0.0)
    end = np.argmin(np.linalg.norm(beam.points - [length - 0.5 * width, 0.5 * width, width], axis=1))
    near = np.argmin(np.linalg.norm(beam.points - [0.1 * width, 0.5 * width, width], axis=1))
    gives = RestResponse(beam, held, POISSON).giving_way(np.array([end, near]), 0.4 * width)
    expected = (length - 0.5 * width) ** 3 / (3.0 * width**4 / 12.0)
    # Linear tetrahedra, six across, are too stiff in bending; what is dented at the end adds a little.
    assert 0.75 * expected < gives[0] < 1.05 * expected
    assert gives[1] < 0.01 * gives[0]


def test_probes_press_where_the_body_does_not_just_bend():
    """A thick block with a thin arm, which a collider would only push away."""
    mesh = box_mesh([0.0, 0.0, 0.0], [0.2, 0.04, 0.05], [40, 8, 10])
    middle = mesh.points[mesh.cells].mean(axis=1)
    arm = (middle[:, 0] > 0.06) & (np.abs(middle[:, 2] - 0.0425) < 0.0075)
    kept = mesh.cells[(middle[:, 0] < 0.06) | arm]
    used, cells = np.unique(kept, return_inverse=True)
    limbed = Mesh(mesh.points[used], cells.reshape(kept.shape))
    settings = choose_settings(limbed, "bottom", 2e4)
    ball = Sphere(settings.collider, 3, "ball")
    probes = probe_scenes(limbed, settings, [("ball", ball)] * 4, np.random.default_rng(1))
    assert all(probe.place[0] < 0.1 for probe in probes)


def test_thickness_of_a_block_is_its_extent(dim):
    mesh = block(dim)
    middle = np.array([0.0] * (dim - 1) + [0.06])
    top = mesh.surface_nodes[np.argmin(np.linalg.norm(mesh.points[mesh.surface_nodes] - middle, axis=1))]
    (found,) = thicknesses(mesh, np.array([top]))
    assert found == pytest.approx(0.06, abs=0.25 * mesh.surface_spacing)


def test_settings_scale_with_the_body(dim):
    """Ten times as large: all lengths are, Young's modulus too (equal strains by weight), and k = 2 E / (c L)^2."""
    small, large = (
        choose_settings(block(dim, 2.0), "bottom", 3e4),
        choose_settings(block(dim, 20.0), "bottom", 3e5),
    )
    for name in ("collider", "max_depth", "thickness"):
        assert getattr(large, name) == pytest.approx(10.0 * getattr(small, name), rel=0.01)  # three digits
    assert large.sag == pytest.approx(small.sag, rel=1e-6)
    assert large.stiffness == pytest.approx(0.1 * small.stiffness, rel=0.03)  # two digits, rounded up
    assert np.allclose(large.hold, 10.0 * small.hold, rtol=0.02)


def test_a_heavy_body_is_made_stiff_enough():
    light, heavy = choose_settings(block(3), "bottom", None), choose_settings(block(3, 20.0), "bottom", None)
    assert light.young == 2e4
    assert heavy.young > 2e4
    assert 0.9 * 0.03 < heavy.sag <= 0.03


def test_sides_hold_what_they_say(dim):
    mesh = block(dim)
    lower, upper = mesh.points.min(axis=0), mesh.points.max(axis=0)
    for side, axis, end in (
        ("bottom", -1, lower),
        ("top", -1, upper),
        ("left", 0, lower),
        ("right", 0, upper),
    ):
        held = mesh.points[in_box(mesh.points, hold_box(mesh, side))]
        assert (np.abs(held[:, axis] - end[axis]) < 0.45 * (upper - lower)[axis]).all()
        assert (held[:, axis] == end[axis]).any()
    with pytest.raises(SoftprintError, match="must be one of"):
        hold_box(mesh, "middle")


def test_scenes_begin_outside_and_press_as_deep_as_they_say(dim):
    mesh = block(dim)
    settings = choose_settings(mesh, "bottom", None)
    ball = Sphere(settings.collider, dim, "ball")
    probes = probe_scenes(mesh, settings, [("ball", ball)] * 6, np.random.default_rng(3))
    again = probe_scenes(mesh, settings, [("ball", ball)] * 6, np.random.default_rng(3))
    surface = surface_points(mesh, 0.1 * settings.collider)
    places = np.array([probe.place for probe in probes])
    assert len(np.unique(places.round(6), axis=0)) == 6
    assert not in_box(places, settings.hold).any()
    for probe, same in zip(probes, again, strict=True):
        times, positions, rotations = map(np.array, zip(*keyframes(probe, settings.pace), strict=True))
        assert np.array_equal(positions, np.array([pose.translation for pose in same.poses]))
        path = KeyframedPath(times, positions, rotations)
        depth = [
            -ball.sdf(path.pose(time).apply_inverse(surface)).min()
            for time in np.linspace(0.0, times[-1], 60)
        ]
        assert depth[0] < -0.3 * settings.collider
        assert depth[-1] < -0.3 * settings.collider
        assert max(depth) <= 1.6 * probe.depth
        at_press = -ball.sdf(probe.poses[2].apply_inverse(surface)).min()
        assert at_press == pytest.approx(probe.depth, rel=1e-3)
        assert probe.depth <= 0.2 * thicknesses(mesh, mesh.surface_nodes).max()


def test_distances_of_concentric_balls():
    ball, shell = (trimesh.creation.icosphere(subdivisions=4, radius=radius) for radius in (1.0, 1.1))
    old, new = ((np.asarray(mesh.vertices), np.asarray(mesh.faces)) for mesh in (ball, shell))
    apart = fidelity(old, new, deep=1.0)
    # Facets of icospheres are up to 0.2 % nearer to the middle than their corners.
    for value in (apart.there_most, apart.there_mean, apart.back_most, apart.back_mean):
        assert value == pytest.approx(0.1, abs=0.004)
    assert apart.buried == 0.0
    assert fidelity(old, new, deep=0.05).buried == 1.0


def test_the_number_of_cells_is_found_where_thin_parts_need_some():
    def fill(edge):
        return np.zeros((0, 3)), np.zeros((int(200 + 0.3 / edge**2.2), 4), dtype=np.int64)

    _, cells, _ = of_wanted_number(fill, 3000, 0.2)
    assert abs(len(cells) / 3000 - 1.0) <= CLOSE


def test_crumbs_go_and_limbs_stay():
    body = box_mesh([0.0, 0.0, 0.0], [1.0, 1.0, 1.0], [4, 4, 4])
    for size, at, enough in ((0.1, 5.0, True), (0.4, 1.2, False)):
        part = box_mesh([at, 0.0, 0.0], [at + size, size, size], [1, 1, 1])
        points = np.vstack([body.points, part.points])
        kept, pieces = largest_piece(points, np.vstack([body.cells, part.cells + body.n_nodes]))
        assert len(kept) == body.n_cells
        assert pieces.count == 2
        assert pieces.share == pytest.approx(1.0 / (1.0 + size**3))
        assert pieces.one_is_enough is enough


@pytest.mark.parametrize(
    ("dim", "ups"), [(2, ("x", "y", "-x", "-y")), (3, ("x", "y", "z", "-x", "-y", "-z"))]
)
def test_up_turns_and_does_not_reflect(dim, ups, tmp_path):
    axes = np.eye(dim)
    for up in ups:
        turned, _ = placed(tmp_path / "x.stl", axes, axes, Placing(up=up))
        assert np.linalg.det(turned) == pytest.approx(1.0)
        assert turned["xyz".index(up[-1])][-1] == (-1.0 if up.startswith("-") else 1.0)


def test_an_outline_of_curves_and_transforms_keeps_its_area(tmp_path):
    path = tmp_path / "ring.svg"
    path.write_text(
        '<svg width="90mm" viewBox="0 0 10 10"><g transform="translate(3 4) scale(2)"><circle r="5"/>'
        '<path d="M-2 0 A 2 2 0 0 0 2 0 A 2 2 0 0 0 -2 0 Z"/></g></svg>'
    )
    mesh = filled_outline(read_outline(path), 400, "ring")
    # 24 chords for each quarter or half of a circle are within 0.4 % of its area.
    assert mesh.cell_volumes.sum() == pytest.approx(np.pi * (10.0**2 - 4.0**2), rel=0.004)
    assert abs(mesh.n_cells / 400 - 1.0) < 0.25
    assert np.allclose(0.5 * (mesh.points.min(axis=0) + mesh.points.max(axis=0)), [3.0, -4.0], atol=0.05)


def test_numbers_are_rounded_up():
    assert [rounded_up(value) for value in (20000.0, 20001.0, 0.0123)] == [20000.0, 21000.0, 0.013]
