"""Strain, stress and contact pressure: compared with closed forms, and as read by VTK and meshio."""

from __future__ import annotations

import argparse
from pathlib import Path

import meshio
import numpy as np
import pytest

from softprint.runtime.cli.context import Context
from softprint.runtime.cli.verbs.fields_verb import VERB as FIELDS
from softprint.runtime.colliders import Plane, Sphere
from softprint.runtime.colliders.pose import RigidPose
from softprint.runtime.contact import PenaltyContact
from softprint.runtime.elasticity.materials import make_material
from softprint.runtime.errors import SoftprintError
from softprint.runtime.fields.deformed import Deformed, fields_of
from softprint.runtime.fields.tensors import cauchy_stress, green_strain, in_three_dimensions, von_mises
from softprint.runtime.fields.vtu import write_collection, write_fields, write_surface
from softprint.runtime.mesh import box_mesh, write_mesh
from softprint.runtime.scenes.motion_file import load_motion
from softprint.runtime.scenes.simulate import motion_path, simulate_scene
from tests.toy_truth import PRESS

AT_NODES = PenaltyContact(1e10, refinement=0)  # whose areas are simple
CONTACT = PenaltyContact(1e10)


def homogeneous(body, F) -> Deformed:
    return Deformed("all", 0.0, body.mesh.points @ F.T + 0.01)


def test_uniaxial_stretch_has_the_published_stress() -> None:
    """E = 1e5, nu = 0.46, stretched to twice its length: P11 = 66327.2507, sides 0.71971603 (closed form of stable
    Neo-Hookean with remapped parameters); sigma_11 = P11 F11 / J and nothing across."""
    side = 0.71971603
    F = np.diag([2.0, side, side])[None]
    stress = cauchy_stress(make_material("stable_neo_hookean", 1e5, 0.46), F)[0]
    axial = 66327.2507 / side**2
    assert stress[0, 0] == pytest.approx(axial, rel=1e-7)  # the digits of the reference
    assert (
        np.abs(stress - np.diag([stress[0, 0], 0, 0])).max() < 5e-3
    )  # Pa: the side is known to 5e-9, the stiffness about 1e6
    assert von_mises(stress[None])[0] == pytest.approx(axial, rel=1e-7)
    np.testing.assert_allclose(
        green_strain(F)[0], np.diag([1.5, (side**2 - 1) / 2, (side**2 - 1) / 2]), rtol=1e-12
    )


def test_every_cell_of_a_homogeneous_deformation_has_its_exact_fields(jelly_body) -> None:
    dim = jelly_body.dim
    F = np.eye(dim) + 0.2 * np.random.default_rng(3).standard_normal((dim, dim))
    fields = fields_of(jelly_body, CONTACT, homogeneous(jelly_body, F))
    in_space = in_three_dimensions(F[None])
    expected = {
        "green_strain": 0.5 * (in_space.transpose(0, 2, 1) @ in_space - np.eye(3)),
        "cauchy_stress": cauchy_stress(jelly_body.material.at(slice(0, 1)), in_space),
        "det_F": np.linalg.det(F),
    }
    for name, value in expected.items():
        # Round-off of gradients: coordinates of 0.1 m over cells of 1 cm; stresses are some 1e4 Pa.
        scale = max(1.0, float(np.abs(value).max()))
        everywhere = np.broadcast_to(value, fields.cells[name].shape)
        np.testing.assert_allclose(fields.cells[name], everywhere, atol=1e-11 * scale)
    moved = jelly_body.mesh.points @ F.T + 0.01
    np.testing.assert_allclose(fields.nodes["displacement"], moved - jelly_body.mesh.points)


def test_rotation_causes_no_strain(jelly3d_body) -> None:
    rotation = RigidPose.from_rotation_vector([0.3, -1.2, 0.8], np.zeros(3)).rotation
    fields = fields_of(jelly3d_body, CONTACT, homogeneous(jelly3d_body, rotation))
    assert np.abs(fields.cells["green_strain"]).max() < 1e-12
    assert np.abs(fields.cells["cauchy_stress"]).max() < 1e-7  # round-off of 1e-12 times 2e4 Pa


def test_plane_strain_agrees_with_the_3d_law(jelly2d_body) -> None:
    """The in-plane stress is that of the 2D law; there is also an out-of-plane stress."""
    F = np.eye(2) + 0.1 * np.random.default_rng(0).standard_normal((5, 2, 2))
    material = make_material("stable_neo_hookean", 2e4, 0.4)
    stress = cauchy_stress(material, in_three_dimensions(F))
    flat = cauchy_stress(material, F)
    np.testing.assert_allclose(stress[:, :2, :2], flat, rtol=1e-10, atol=1e-8)  # round-off
    assert (np.abs(stress[:, 2, 2]) > 1.0).all()


def test_flat_contact_has_uniform_pressure_that_sums_to_the_force(jelly_body) -> None:
    """A wall 2 mm into the top: p = k d^2 on the top and nowhere else inside it, F = k d^2 A."""
    dim, depth, mesh = jelly_body.dim, 2e-3, jelly_body.mesh
    top = float(mesh.points[:, -1].max())
    wall = Plane([0.0] * (dim - 1) + [-1.0], name="wall")  # solid above
    pose = RigidPose(np.eye(dim), np.array([0.0] * (dim - 1) + [top - depth]))
    fields = fields_of(jelly_body, AT_NODES, Deformed("p", 0.0, mesh.points, [(wall, pose)]))
    pressure, force = fields.nodes["contact_pressure"], fields.nodes["contact_force"]
    touched = mesh.points[:, -1] > top - depth
    # Round-off of coordinates of 0.1 m in a depth of 2 mm.
    np.testing.assert_allclose(pressure[touched], 1e10 * depth**2, rtol=1e-9)
    assert (pressure[~touched] == 0).all()
    area = mesh.surface_areas[touched[mesh.surface_nodes]].sum()
    np.testing.assert_allclose(force.sum(axis=0)[-1], -1e10 * depth**2 * area, rtol=1e-9)
    assert np.abs(force.sum(axis=0)[:-1]).max() < 1e-9 * abs(force.sum())


def test_meshio_and_vtk_read_the_same_numbers(tmp_path: Path, jelly_body) -> None:
    pv = pytest.importorskip("pyvista")
    dim = jelly_body.dim
    pose = RigidPose(np.eye(dim), np.array([0.0] * (dim - 1) + [0.075]))
    F = np.eye(dim) + 0.1 * np.random.default_rng(1).standard_normal((dim, dim))
    deformed = Deformed(
        *("x", 0.5, jelly_body.mesh.points @ F.T, [(Sphere(0.02, dim=dim), pose)]),
        node_values={"contact_displacement": np.random.default_rng(0).random((jelly_body.n_nodes, dim))},
    )
    fields = fields_of(jelly_body, CONTACT, deformed)
    path = tmp_path / "part" / "x.vtu"
    write_fields(path, fields)
    by_meshio, by_vtk = meshio.read(path), pv.read(path)
    for name, values in fields.nodes.items():
        wide = values if values.ndim == 1 else np.pad(values, ((0, 0), (0, 3 - dim)))
        np.testing.assert_array_equal(by_vtk.point_data[name], wide)
        np.testing.assert_array_equal(by_meshio.point_data[name], wide)
    for name, values in fields.cells.items():
        flat = values if values.ndim == 1 else values.reshape(len(values), 9)
        np.testing.assert_array_equal(by_vtk.cell_data[name], flat)
        np.testing.assert_array_equal(by_meshio.cell_data[name][0].reshape(flat.shape), flat)
    np.testing.assert_array_equal(by_vtk.points[:, :dim], deformed.positions)
    # ParaView's own strain filter starts from such a file: the gradient of the displacement gives F back.
    rest = by_vtk.copy()
    rest.points = by_vtk.points - by_vtk.point_data["displacement"]
    gradient = rest.compute_derivative("displacement", gradient=True).point_data["gradient"].reshape(-1, 3, 3)
    np.testing.assert_allclose(
        gradient[:, :dim, :dim] + np.eye(dim), np.broadcast_to(F, (len(gradient), dim, dim)), atol=1e-9
    )


def test_a_collection_is_a_series_in_time(tmp_path: Path, jelly3d_body) -> None:
    pv = pytest.importorskip("pyvista")
    parts = []
    for k in range(3):
        path = tmp_path / "s" / f"{k}.vtu"
        write_surface(path, jelly3d_body.mesh.points + k, jelly3d_body.mesh.facets)
        parts.append((0.25 * k, "ball", path))
    write_collection(tmp_path / "s.pvd", parts)
    reader = pv.get_reader(tmp_path / "s.pvd")
    assert reader.time_values == [0.0, 0.25, 0.5]
    reader.set_active_time_value(0.5)
    np.testing.assert_allclose(reader.read()[0].points, jelly3d_body.mesh.points + 2, rtol=1e-12)


@pytest.fixture
def context(tmp_path):
    write_mesh(tmp_path / "box.vtu", box_mesh([0.0, 0.0], [0.1, 0.05], [10, 5]))
    # Contact at nodes, which full space, whose contact the fields have, and the bare subspace have alike.
    (tmp_path / "toy.toml").write_text(PRESS.replace("[contact]", "[contact]\nrefinement = 0"))
    return Context(tmp_path / "toy.toml", out=tmp_path / "run", quiet=True, rank=0, write=lambda text: None)


def options(**given) -> argparse.Namespace:
    return argparse.Namespace(**{"sample": None, "contact": None, "motion": None, "frame": None, **given})


def test_the_fields_of_a_motion_carry_its_contact_force(context) -> None:
    from softprint.runtime.cli.run_body import body_of_run

    pv = pytest.importorskip("pyvista")
    simulate_scene(context, body_of_run(context), context.experiment.scenes[0], "bare")
    assert FIELDS.run(options(motion="press_bare"), context) == 0
    motion = load_motion(motion_path(context.out_dir, "press", "bare"))
    reader = pv.get_reader(context.out_dir / "fields" / "press_bare.pvd")
    np.testing.assert_allclose(reader.time_values, motion.times)
    assert np.abs(motion.colliders["ball"].force[-1]).max() > 0.1  # N: it does press
    for frame, time in enumerate(reader.time_values):
        reader.set_active_time_value(time)
        body, ball = reader.read()
        # Positions in the motion file are float32: 4e-9 m in a depth of some 1e-4 m.
        np.testing.assert_allclose(
            body["contact_force"].sum(axis=0)[:2], -motion.colliders["ball"].force[frame], atol=2e-4
        )
        centre = motion.colliders["ball"].poses[frame].translation
        np.testing.assert_allclose(np.linalg.norm(ball.points[:, :2] - centre, axis=1), 0.02, rtol=1e-3)


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"frame": [3]}, "name it with --motion"),
        ({"motion": "press_bare", "sample": [3]}, "give one of the two"),
        ({"motion": "press_bare"}, "no such motion file"),
        ({}, "no such truth file"),
    ],
)
def test_missing_files_and_frames_are_reported(context, given, words) -> None:
    with pytest.raises(SoftprintError, match=words):
        FIELDS.run(options(**given), context)
    assert not (context.out_dir / "fields").exists()
