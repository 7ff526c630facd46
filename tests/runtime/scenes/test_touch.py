"""`softprint touch`: forces that balance, stress and strain compared with closed forms, and time series with units."""

from __future__ import annotations

import argparse
import csv
from dataclasses import replace

import h5py
import numpy as np
import pytest

from softprint.runtime.body import assemble_body, frame_in_box, place_handles
from softprint.runtime.cli.context import Context
from softprint.runtime.cli.verbs.touch_verb import VERB, configure
from softprint.runtime.colliders import Plane, RigidPose, Sphere
from softprint.runtime.contact import CoulombFriction, PenaltyContact
from softprint.runtime.dynamics import KinematicHandle, PlacedCollider, Simulator
from softprint.runtime.elasticity.materials import make_material
from softprint.runtime.errors import SoftprintError
from softprint.runtime.inspect.kind import inspect_file
from softprint.runtime.mechanics.body_mechanics import compute_mechanics
from softprint.runtime.mesh import box_mesh, write_mesh
from softprint.runtime.touch import TouchSensor, point_places, surface_places
from tests.toy_truth import PRESS

STIFFNESS = 1e9  # N/m^4
TOP = 0.06  # m, of the blocks
RADIUS = 0.02


def ball_at(dim, depth, along=0.0):
    return {"ball": RigidPose(np.eye(dim), np.append(np.eye(dim - 1)[0] * along, TOP + RADIUS - depth))}


def mechanics_of(body):
    return compute_mechanics(body, 200, True)


def simulator_of(body, mechanics=None, friction=0.4, refinement=0):
    """Contact is condensed if there are mechanics, otherwise penalty at the surface."""
    return Simulator(
        body,
        [PlacedCollider("ball", Sphere(RADIUS, body.dim, "ball"))],
        contact=PenaltyContact(STIFFNESS, refinement),
        mechanics=mechanics,
        friction=CoulombFriction(friction) if friction else None,
        kinematic=[KinematicHandle("base")],
    )


@pytest.mark.parametrize("refinement", [0, 1], ids=["at nodes", "on facets"])
@pytest.mark.parametrize("condensed", [False, True], ids=["penalty", "condensed"])
def test_the_traction_over_the_surface_is_the_contact_force_friction_included(
    jelly_body, dim, condensed, refinement
) -> None:
    mechanics = mechanics_of(jelly_body) if condensed else None
    simulator = simulator_of(jelly_body, mechanics, refinement=refinement)
    places = surface_places(jelly_body)
    sensor = TouchSensor(simulator, jelly_body, places)
    state = simulator.rest_state(poses=ball_at(dim, 0.0))
    for step in range(1, 7):  # down, and sideways
        result = simulator.step(state, ball_at(dim, 1e-3 * step, 5e-4 * step))
        state = result.state
        felt = sensor.feel(result)
        force = result.contacts["ball"].force
        # A sum in another order.
        np.testing.assert_allclose(-places.areas @ felt.traction, force, atol=1e-12 * np.linalg.norm(force))
    assert np.abs(force[0]) > 0.05 * np.abs(force[-1])  # friction does drag
    assert (felt.pressure >= 0).all()
    pushed = [part for part in result.contacts["ball"].parts if not part.tangential]
    assert places.areas @ felt.pressure == pytest.approx(
        np.linalg.norm(pushed[0].forces, axis=1).sum(), rel=1e-12
    )
    assert np.sum(places.areas) == pytest.approx(jelly_body.mesh.surface_areas.sum(), rel=1e-12)


YOUNG, POISSON = 2e4, 0.3


def squeezed(dim, stiffness, depth, refinement=0):
    """A block between two planes, free to widen: stress and strain at its surface, the force of a plane and the
    samples."""
    mesh = box_mesh(
        [-0.05] * (dim - 1) + [0.0], [0.05] * (dim - 1) + [TOP], [6, 4] if dim == 2 else [4, 4, 3]
    )
    body = assemble_body(
        mesh,
        place_handles(mesh, 2**dim + 2, []),
        make_material("linear", YOUNG, POISSON),
        1000.0,
        name="block",
    )
    up = np.eye(dim)[-1]
    walls = [
        PlacedCollider("above", Plane(list(-up), "above")),
        PlacedCollider("below", Plane(list(up), "below")),
    ]
    simulator = Simulator(body, walls, contact=PenaltyContact(stiffness, refinement))
    poses = {"above": RigidPose(np.eye(dim), (TOP - depth) * up), "below": RigidPose(np.eye(dim), depth * up)}
    result = simulator.settle(simulator.rest_state(poses=poses))
    assert result.converged
    places = surface_places(body)
    felt = TouchSensor(simulator, body, places).feel(result)
    return felt, np.linalg.norm(result.contacts["above"].force), places


def test_a_block_between_hard_planes_is_strained_by_hookes_law(dim) -> None:
    felt, force, _ = squeezed(dim, 1e12, 1e-3)
    # Nearly uniform: the lumped areas of nodes at the rim include some of the sides, on which pressure acts too.
    strain = felt.green_strain[:, -1, -1]
    np.testing.assert_allclose(strain, strain.mean(), rtol=0.02)
    stretch = np.sqrt(2 * strain.mean() + 1)
    modulus = YOUNG if dim == 3 else YOUNG / (1 - POISSON**2)  # plane strain in the plane
    # F / A on the solid's true area, and engineering strain.
    assert force / 0.1 ** (dim - 1) == pytest.approx(modulus * (1 - stretch), rel=5e-3)


def test_on_facets_a_block_is_strained_evenly_up_to_its_rim(dim) -> None:
    strain = squeezed(dim, 1e12, 1e-3, refinement=1)[0].green_strain[:, -1, -1]
    # Every facet bears what its own area does: twenty times as even as at nodes, where the rim bears too much.
    np.testing.assert_allclose(strain, strain.mean(), rtol=1e-3)


def test_pressure_between_soft_planes_is_force_over_area(dim) -> None:
    """Pressure is k depth^2, and a depth of millimetres is even where the top is uneven by micrometres."""
    felt, force, places = squeezed(dim, 1e6, 4e-3)
    top = np.isclose(places.rest[:, -1], TOP)
    assert (felt.pressure > 0).sum() == 2 * top.sum()
    # Mesh and handles of the solid are not symmetric, nothing keeps it upright, and it leans by a tenth of a degree:
    # 0.1 mm in a depth of 4.
    even = 0.01 if dim == 2 else 0.08
    np.testing.assert_allclose(felt.pressure[top], force / places.areas[top].sum(), rtol=even)
    up = np.eye(dim)[-1]
    np.testing.assert_allclose(felt.traction[top], -felt.pressure[top, None] * up, rtol=1e-9, atol=1e-9)
    bottom = np.isclose(places.rest[:, -1], 0.0)
    np.testing.assert_allclose(felt.traction[bottom], felt.pressure[bottom, None] * up, rtol=1e-9, atol=1e-9)


def test_pressure_is_largest_where_a_ball_is_deepest() -> None:
    """As in Hertz's contact: pressure decreases from the middle to zero."""
    mesh = box_mesh([-0.05, -0.05, 0.0], [0.05, 0.05, TOP], [16, 16, 5])
    handles = place_handles(mesh, 8, [frame_in_box(mesh, "base", [[-1, -1, -1], [1, 1, 0.013]])])
    body = assemble_body(mesh, handles, make_material("stable_neo_hookean", 2e4, 0.4), 1000.0, name="block")
    for mechanics in (None, mechanics_of(body)):
        simulator = simulator_of(body, mechanics, friction=0.0)
        pose = {"ball": RigidPose(np.eye(3), np.array([0.0083, 0.0083, TOP + RADIUS - 8e-3]))}
        result = simulator.settle(simulator.rest_state(poses=pose))
        places = surface_places(body)
        felt = TouchSensor(simulator, body, places).feel(result)
        away = np.linalg.norm(felt.position - pose["ball"].translation, axis=1)
        peak = np.argmax(felt.pressure)
        assert np.linalg.norm(places.rest[peak, :2] - 0.0083) < 0.1 / 16  # within an edge of the mesh
        assert felt.pressure[peak] > 0
        bearing = felt.pressure > 0
        # Active nodes are near the ball, and deeper ones have more pressure. With mechanics the surface gives way, by
        # forces at some of its nodes only.
        assert away[bearing].max() < RADIUS + (0.0 if mechanics is None else 2e-3)
        order = np.argsort(np.linalg.norm(places.rest[bearing, :2] - 0.0083, axis=1))
        assert felt.pressure[bearing][order][0] > felt.pressure[bearing][order][-1]


def test_affine_deformation_has_its_exact_strain_and_a_rotation_has_none(dim) -> None:
    mesh = box_mesh([0.0] * dim, [0.1] * dim, [4] * dim)
    body = assemble_body(
        mesh, place_handles(mesh, 2**dim + 1, []), make_material("linear", 1e4, 0.3), 1000.0, name="b"
    )
    simulator = Simulator(body, [], contact=PenaltyContact(1e9))
    rest = simulator.at_rest()
    points = point_places(body, {"a": [0.1, *[0.033] * (dim - 1)], "corner": [0.0] * dim})
    motion = RigidPose.from_rotation_vector([0.7] if dim == 2 else [0.4, -0.5, 0.6], np.full(dim, 0.2))
    A = np.eye(dim) + 0.2 * np.random.default_rng(0).normal(size=(dim, dim))
    for places in (points, surface_places(body)):
        sensor = TouchSensor(simulator, body, places)
        for F, shift in ((A, np.full(dim, -0.1)), (motion.rotation, motion.translation)):
            moved = replace(rest, state=replace(rest.state, rows=body.rest_rows @ F.T + shift))
            felt = sensor.feel(moved)
            expected = 0.5 * (F.T @ F - np.eye(dim))
            # The basis is solved for to about 1e-10, over edges of 25 mm.
            np.testing.assert_allclose(
                felt.green_strain, np.broadcast_to(expected, felt.green_strain.shape), atol=1e-8
            )
            np.testing.assert_allclose(felt.strain_norm, np.linalg.norm(expected), atol=1e-8)
            np.testing.assert_allclose(felt.position, places.rest @ F.T + shift, atol=1e-9)
            assert not felt.pressure.any()


class Spy:
    def __init__(self, body) -> None:
        self.body = body

    def follow(self, nodes):
        self.nodes = nodes
        return lambda state: self.body.mesh.points[nodes]


def test_the_cost_of_a_point_does_not_depend_on_the_mesh_size(dim) -> None:
    looked_at = []
    for cells in (6, 12):
        mesh = box_mesh([0.0] * dim, [0.1] * dim, [cells] * dim)
        body = assemble_body(
            mesh, place_handles(mesh, 2**dim, []), make_material("linear", 1e4, 0.3), 1e3, name="b"
        )
        spy = Spy(body)
        TouchSensor(spy, body, point_places(body, {"a": [0.1, *[0.04] * (dim - 1)]}))
        looked_at.append(len(spy.nodes))
    assert looked_at[1] <= looked_at[0] + 4  # the point's place in its facet decides
    assert looked_at[1] < 50


def test_points_are_projected_to_the_surface_and_invalid_ones_refused(jelly3d_body) -> None:
    places = point_places(jelly3d_body, {"above": [0.012, -0.003, TOP + 0.002], "node": [0.05, 0.05, TOP]})
    np.testing.assert_allclose(places.rest, [[0.012, -0.003, TOP], [0.05, 0.05, TOP]], atol=1e-12)
    assert places.names == ("above", "node")
    for points, words in (
        ({"p": [0.0, 0.0]}, "point 'p' must be 3 numbers"),
        ({"p": [0.0, 0.0, np.nan]}, "point 'p' must be 3 numbers"),
        ({"p": [0.0, 0.0, 0.2]}, r"point 'p' is 0.14 m away .* the nearest point of it is 0, 0, 0.06"),
        ({}, "no sensing point"),
    ):
        with pytest.raises(SoftprintError, match=words):
            point_places(jelly3d_body, points)


@pytest.fixture
def context(tmp_path):
    write_mesh(tmp_path / "box.vtu", box_mesh([0.0, 0.0], [0.1, 0.05], [10, 5]))
    (tmp_path / "toy.toml").write_text(PRESS)
    said: list[str] = []
    return Context(tmp_path / "toy.toml", out=tmp_path / "run", quiet=True, rank=0, write=said.append)


def call(context, *arguments: str) -> int:
    parser = argparse.ArgumentParser()
    configure(parser)
    return VERB.run(parser.parse_args(arguments), context)


def test_the_verb_writes_a_table_with_units_a_picture_and_arrays(context) -> None:
    assert call(context, "--point", "hit=0.08,0.05", "--point", "far=0.02,0.05", "--surface") == 0
    folder = context.out_dir / "touch"
    assert sorted(path.name for path in folder.iterdir()) == [
        "press_bare.csv",
        "press_bare.h5",
        "press_bare.png",
    ]
    with (folder / "press_bare.csv").open(newline="") as file:
        rows = list(csv.reader(file))
    table = dict(zip(rows[0], np.array(rows[1:], dtype=float).T, strict=True))
    assert {"time [s]", "hit.pressure [Pa]", "hit.traction_y [Pa]", "hit.green_strain_xy [1]"} < set(table)
    assert "hit.green_strain_yx [1]" not in table
    assert table["hit.pressure [Pa]"][-1] > 100 > table["far.pressure [Pa]"].max()
    assert table["hit.traction_y [Pa]"][-1] < 0  # the ball pushes down
    with h5py.File(folder / "press_bare.h5") as file:
        assert file["traction"].attrs["unit"] == b"Pa"
        np.testing.assert_array_equal(file["times"], table["time [s]"])
        force = -np.einsum("k,fkd->fd", file["areas"], file["traction"])
    assert force[-1, 1] > 0.1  # N
    summary = inspect_file(folder / "press_bare.h5").as_text()
    assert "press, bare" in summary
    assert "frames in contact" in summary
    assert (folder / "press_bare.png").stat().st_size > 5000


def test_the_command_simulates_another_shape(context, capsys) -> None:
    np.savetxt(context.out_dir / "roof.txt", [[-2, 0], [2, 0], [0, 1]])
    call(context, "--scene", "press", "--collider", str(context.out_dir / "roof.txt"))
    assert (context.out_dir / "touch" / "press_with_roof_bare.csv").is_file()
    with pytest.raises(SoftprintError, match="--collider mug: is the second without the name of the collider"):
        call(context, "--collider", "hat", "--collider", "mug")
    with pytest.raises(SoftprintError, match="--collider-scale belongs to"):
        call(context, "--collider-scale", "0.1")
    for wrong in ("abc", "-1", "nan"):
        with pytest.raises(SystemExit):
            call(context, "--collider", "roof.txt", "--collider-scale", wrong)
        assert f"'{wrong}' is not a positive number of metres" in capsys.readouterr().err


def test_the_command_refuses_points_with_a_clear_error(context, capsys) -> None:
    with pytest.raises(SoftprintError, match="two points have the same name"):
        call(context, "--point", "a=0,0", "--point", "a=0.1,0")
    with pytest.raises(SoftprintError, match="must be 2 numbers"):
        call(context, "--point", "a=0,0,0")
    with pytest.raises(SystemExit):
        call(context, "--point", "0,0")
    assert "is not of the form NAME=X,Y,Z" in capsys.readouterr().err
    assert not (context.out_dir / "touch").exists()


def test_the_command_writes_what_a_camera_sees(context, capsys) -> None:
    assert call(context, "--markers", "6", "--model", "bare", "--model", "bare") == 0
    folder = context.out_dir / "touch"
    with h5py.File(folder / "press_bare_camera.h5") as file:
        frames = len(file["times"])
        assert file["markers"].shape == (frames, 6, 2)
        assert file["depth"].shape == (frames, 64)
        assert file["force"][-1, 1] < -0.1  # N: the ball presses the body
        assert file["depth"][-1].max() > 1e-4  # m
    assert (folder / "press_bare_camera.png").stat().st_size > 5000
    for options, words in (
        (["--side", "+x"], "add --markers or --depth-image"),
        (["--markers", "6x5"], "must be 1 whole number"),
        (["--depth-image", "20", "--field", "9"], "no larger than the side"),
    ):
        with pytest.raises(SoftprintError, match=words):
            call(context, *options)
    for option, wrong in (("--markers", "6by5"), ("--field", "wide")):
        with pytest.raises(SystemExit):
            call(context, option, wrong)
        assert "is not of the form" in capsys.readouterr().err
