"""The layout of the published data sets: export and import of ours, and files with other layouts."""

from __future__ import annotations

import argparse
from pathlib import Path

import h5py
import numpy as np
import pytest

from softprint.runtime.body import load_body
from softprint.runtime.cli.context import Context
from softprint.runtime.cli.run_body import body_of_run
from softprint.runtime.cli.verbs.import_verb import VERB as IMPORT
from softprint.runtime.colliders import Sphere
from softprint.runtime.colliders.pose import RigidPose
from softprint.runtime.errors import SoftprintError
from softprint.runtime.published import export
from softprint.runtime.published.adopt import adopted_poses, group_samples
from softprint.runtime.published.export import export_published, published_collider, published_meshes
from softprint.runtime.published.handles import find_handles
from softprint.runtime.published.layout import PublishedMeshes, open_dataset, read_meshes, write_meshes
from softprint.runtime.truth.truth_file import load_truth
from softprint.runtime.truth.truth_schema import CONVERGED
from tests.toy_truth import turned, write_truth

F32 = 2e-7  # float32 rounds by 6e-8 of a number; sums of a few by three times that


@pytest.fixture
def exported(tmp_path, jelly_body, monkeypatch):
    """Our truth, and the same in the published layout; the ball is coarse, to be quick."""
    monkeypatch.setattr(export, "CELLS", {2: 40, 3: 10})
    write_truth(tmp_path / "truth.h5", jelly_body)
    with load_truth(tmp_path / "truth.h5", jelly_body) as truth:
        collider = Sphere(0.02, dim=jelly_body.dim, name="ball")
        meshes, dataset, count = export_published(tmp_path / "published", truth, jelly_body, collider)
        assert count == 5
        yield jelly_body, truth, meshes, dataset


def test_shapes_and_rows_are_those_of_the_published_tables(exported) -> None:
    body, truth, meshes, dataset = exported
    dim, n_points = body.dim, body.handles.n_points
    with h5py.File(meshes) as file:
        mesh, ball = file[body.name], file["ball"]
        assert mesh["W"].shape == (body.n_nodes, body.n_rows)
        assert mesh["q_ref"].shape == (body.n_rows, dim)
        assert mesh["tris"].shape[1] == 3
        assert mesh["tets"].shape == (body.mesh.n_cells, dim + 1)
        assert ball["W"].shape[1] == dim + 1
        assert ball["z_ref"].shape == (dim + 1, dim)
        # Frames first, as the published code has them: R^T = I above t = 0, then the points at rest.
        np.testing.assert_array_equal(mesh["q_ref"][: dim + 1], np.vstack([np.eye(dim), np.zeros(dim)]))
        rest = body.mesh.points[body.handles.points]
        np.testing.assert_allclose(mesh["q_ref"][dim + 1 :], rest, rtol=F32, atol=1e-12)
        np.testing.assert_allclose(mesh["W"][()] @ mesh["q_ref"][()], body.mesh.points, atol=0.1 * 1e-6)
    with h5py.File(dataset) as file:
        # The positions of the collider are W z, row vectors: z_local R^T + t.
        pose = truth.pose(1)
        np.testing.assert_allclose(file["z"][1], np.vstack([pose.rotation.T, pose.translation]), atol=F32)
        np.testing.assert_allclose(file["q"][4, dim + 1 :], truth.states["rows"][1][:n_points], atol=F32)
        x = body.reduced_positions(truth.states["rows"][1]) + truth.internal(1) + truth.displacement(5)
        np.testing.assert_allclose(file["x"][4], x, atol=0.1 * F32)  # a body of 0.1 m
        assert all(file[name].dtype == np.float32 for name in "qzx")


def run_import(dataset: Path, meshes: Path, out: Path, scale: float = 1.0) -> list[str]:
    said: list[str] = []
    args = argparse.Namespace(
        **{"dataset": dataset, "meshes": meshes, "out": out, "scale": scale},
        **{"young": 2e4, "poisson": 0.4, "density": 1000.0, "material": "stable_neo_hookean"},
    )
    assert IMPORT.run(args, Context(quiet=True, rank=0, write=said.append)) == 0
    return said


def check_adopted(folder: Path, body, truth) -> None:
    """The imported files have the content of the truth, up to the rounding of float32."""
    adopted = load_body(folder / "body.h5")
    order = adopted_order(adopted, body)
    np.testing.assert_array_equal(adopted.mesh.cells, body.mesh.cells)
    np.testing.assert_allclose(adopted.mesh.points, body.mesh.points, atol=0.1 * F32)
    np.testing.assert_allclose(adopted.basis, body.basis[:, order], atol=2e-6)  # after a product with W
    np.testing.assert_array_equal(adopted.handles.frames[0].nodes, body.handles.frames[0].nodes)
    samples = np.array([0, 1, 2, 4, 5])
    with load_truth(folder / "truth.h5", adopted) as data:
        assert data.header.colliders == ("ball",)
        np.testing.assert_array_equal(data.sample_state, truth.sample_state[samples])
        np.testing.assert_array_equal(data.samples["contact"], [0, 0, 1, 2, 2])
        np.testing.assert_array_equal(data.samples["depth_index"], [0, 1, 0, 0, 1])
        np.testing.assert_allclose(data.states["rows"], truth.states["rows"][:, order], atol=2e-6)
        for ours, theirs in enumerate(samples):
            state = int(truth.sample_state[theirs])
            # Internal deformation cannot be separated from contact: it is all displacement. U q comes from float32
            # arrays.
            whole = truth.internal(state) + truth.displacement(int(theirs))
            np.testing.assert_allclose(data.displacement(ours), whole, atol=1e-6)
            np.testing.assert_allclose(data.pose(ours).rotation, truth.pose(theirs).rotation, atol=2e-6)
            np.testing.assert_allclose(data.pose(ours).translation, truth.pose(theirs).translation, atol=1e-7)
        assert (data.samples["status"] == CONVERGED).all()
        assert (np.diff(data.samples["depth"][:2]) > 5e-4).all()  # it came 1 mm deeper


def adopted_order(adopted, body) -> np.ndarray:
    """Our row of each row of the adopted body; its points may come in another order."""
    place = {node: row for row, node in enumerate(body.handles.points)}
    points = [place[node] for node in adopted.handles.points]
    return np.array([*points, *range(body.handles.n_points, body.n_rows)])


def test_an_export_can_be_imported(exported, tmp_path) -> None:
    body, truth, meshes, dataset = exported
    said = run_import(dataset, meshes, tmp_path / "in")
    check_adopted(tmp_path / "in", body, truth)
    assert any("material" in line and "Internal" in line for line in said)
    # It can be used for training: the experiment gives the written body, to the last bit, as every verb requires.
    context = Context(tmp_path / "in" / "experiment.toml", out=tmp_path / "in", quiet=True, rank=0)
    own = body_of_run(context)
    assert own.hold == "projection"  # as in the papers, whatever the default
    with load_truth(tmp_path / "in" / "truth.h5", own) as data:
        assert data.header.experiment == context.experiment.text


def test_other_orders_frames_and_units_are_imported_alike(exported, tmp_path) -> None:
    """Rows in another order, a frame with a different origin and its translation first, a collider that is rotated at
    rest, all in millimetres: none of this matters to a reader of W and q_ref."""
    body, truth, meshes, dataset = exported
    dim, mm, rng = body.dim, 1000.0, np.random.default_rng(5)
    # q' = A q: the points in some order, then the frame's rows as the position of its origin and its axes.
    origin = rng.standard_normal(dim)
    axes = np.column_stack([0.01 * turned(dim, 1.0), np.zeros(dim)])
    frame = np.vstack([np.append(origin, 1.0), axes])
    change = np.zeros((body.n_rows, body.n_rows))
    n_points = body.handles.n_points
    change[np.arange(n_points), dim + 1 + rng.permutation(n_points)] = 1.0
    change[n_points:, : dim + 1] = frame
    pose = np.vstack([np.column_stack([turned(dim, 0.7), np.zeros(dim)]), np.append(np.full(dim, 0.02), 1.0)])
    in_mm = np.r_[np.ones(dim), mm]  # only translations have a unit; the basis of a frame has the other
    with h5py.File(meshes, "r+") as file, h5py.File(dataset, "r+") as data:
        unit = np.diag(np.r_[in_mm, np.full(n_points, mm)])
        jelly, ball = file[body.name], file["ball"]
        w, q_ref = jelly["W"][()].astype(float), jelly["q_ref"][()].astype(float)
        w[:, :dim] *= mm
        new = np.linalg.inv(change)
        replace(jelly, "W", w @ new)
        replace(jelly, "q_ref", change @ unit @ q_ref)
        replace(data, "q", change @ unit @ data["q"][()])
        replace(data, "x", mm * data["x"][()])
        w = ball["W"][()] * np.r_[np.full(dim, mm), 1.0]
        replace(ball, "W", w @ np.linalg.inv(pose))
        replace(ball, "z_ref", pose @ np.diag(in_mm) @ ball["z_ref"][()])
        replace(data, "z", pose @ np.diag(in_mm) @ data["z"][()])
    run_import(dataset, meshes, tmp_path / "in", scale=1e-3)
    check_adopted(tmp_path / "in", body, truth)


def replace(group, name: str, values) -> None:
    del group[name]
    group[name] = np.asarray(values)


def test_rigid_motions_are_found_from_points_alone(dim) -> None:
    collider = published_collider(Sphere(0.02, dim=dim, name="ball"))
    poses = [RigidPose(turned(dim, angle), np.full(dim, 0.01 * angle)) for angle in (0.0, 0.4, 2.5, -3.0)]
    z = np.stack([np.vstack([pose.rotation.T, pose.translation]) for pose in poses])
    rotation, translation = adopted_poses(collider, z, 0.5, "file")
    np.testing.assert_allclose(rotation, [pose.rotation for pose in poses], atol=1e-12)
    np.testing.assert_allclose(translation, [0.5 * pose.translation for pose in poses], atol=1e-12)
    z[1] *= 1.1
    with pytest.raises(SoftprintError, match="does not move rigidly"):
        adopted_poses(collider, z, 0.5, "file")


def test_samples_of_one_state_and_rotation_in_a_row_are_a_contact() -> None:
    q = (
        np.array([0, 0, 1, 1, 0, 0, 2.0])[:, None, None] + 1e-7 * np.arange(7)[:, None, None]
    )  # float32's noise
    turn = np.array([0, 0, 0, 1, 1, 1, 1.0])[:, None, None]
    groups = group_samples(q, turn)
    np.testing.assert_array_equal(groups.state, [0, 0, 1, 1, 0, 0, 2])
    np.testing.assert_array_equal(groups.contact, [0, 0, 1, 2, 3, 3, 4])
    np.testing.assert_array_equal(groups.depth_index, [0, 1, 0, 0, 0, 1, 0])
    np.testing.assert_array_equal(groups.first_of_state, [0, 2, 6])


def test_files_without_a_published_data_set_are_refused(exported, tmp_path) -> None:
    body, _, meshes, dataset = exported
    with pytest.raises(SoftprintError, match="there is no such file"):
        read_meshes(tmp_path / "gone.h5")
    with pytest.raises(SoftprintError, match="group with W and q_ref"):
        read_meshes(dataset)
    good = read_meshes(meshes)
    with pytest.raises(SoftprintError, match="not in the published layout"), open_dataset(meshes, good):
        pass
    smaller = PublishedMeshes(good.collider, good.body)
    with pytest.raises(SoftprintError, match="its meshes need"), open_dataset(dataset, smaller):
        pass
    good.body.basis[:, -1] += 0.01  # no node follows the last point alone any more
    with pytest.raises(SoftprintError, match=r"column \d+ of .*neither a point handle"):
        find_handles(good.body, "meshes.h5")
    with h5py.File(meshes, "r+") as file:
        file[body.name]["tets"][0, 0] = 10**6
    with pytest.raises(SoftprintError, match="has nodes that do not exist"):
        read_meshes(meshes)
    (tmp_path / "cut.h5").write_bytes(dataset.read_bytes()[:3000])
    with (
        pytest.raises(SoftprintError, match="not a readable HDF5 file"),
        open_dataset(tmp_path / "cut.h5", good),
    ):
        pass


def test_outlines_of_the_plane_may_be_edges(exported, tmp_path) -> None:
    """The table of 2022 has `tris` (n, dim): in the plane those are the edges of the collider."""
    body, truth, meshes, dataset = exported
    if body.dim == 3:
        pytest.skip("of the plane")
    from softprint.runtime.colliders.level_set import collider_surface

    vertices, edges = collider_surface(Sphere(0.02, dim=2, name="ball"), 60)
    with h5py.File(meshes, "r+") as file:
        replace(file["ball"], "W", np.column_stack([vertices, np.ones(len(vertices))]))
        replace(file["ball"], "tris", edges)
    run_import(dataset, meshes, tmp_path / "in")
    check_adopted(tmp_path / "in", body, truth)


def test_meshes_written_are_meshes_read(tmp_path, jelly_body) -> None:
    meshes = published_meshes(jelly_body, Sphere(0.02, dim=jelly_body.dim, name="ball"))
    write_meshes(tmp_path / "meshes.h5", meshes, {"unit": "m"})
    read = read_meshes(tmp_path / "meshes.h5")
    for ours, theirs in ((meshes.body, read.body), (meshes.collider, read.collider)):
        np.testing.assert_array_equal(ours.basis.astype(np.float32), theirs.basis)
        np.testing.assert_array_equal(ours.reference.astype(np.float32), theirs.reference)
        for name, array in ours.simplices.items():
            np.testing.assert_array_equal(array, theirs.simplices[name])
