"""`softprint collider`: what it reports, repairs and refuses."""

from __future__ import annotations

import argparse
import json

import numpy as np
import pytest
import trimesh

from softprint.runtime.cli.context import Context
from softprint.runtime.cli.verbs.collider_verb import VERB
from softprint.runtime.colliders.surface_mesh.examine import examine
from softprint.runtime.colliders.surface_mesh.mesh_collider import read_surface
from softprint.runtime.colliders.surface_mesh.rebuild import misplaced
from softprint.runtime.colliders.surface_mesh.repair import closed_surface
from softprint.runtime.errors import SoftprintError

RADIUS = 0.03
BALL = 4 / 3 * np.pi * RADIUS**3


def ball(centre=(0.0, 0.0, 0.0)):
    mesh = trimesh.creation.icosphere(subdivisions=3, radius=RADIUS)
    return np.array(mesh.vertices) + centre, np.array(mesh.faces, dtype=np.int64)


def volume(examined) -> float:
    return float(np.linalg.det(examined.vertices[examined.triangles]).sum() / 6)


def test_a_valid_mesh_is_not_changed() -> None:
    vertices, triangles = ball()
    examined = examine(vertices, triangles, "ball")
    assert (examined.done, examined.refusal) == ([], "")
    wrong = ("repeated", "degenerate", "open", "more than two", "opposite", "overlapping")
    assert not any(number for label, number in examined.found.items() if any(word in label for word in wrong))
    assert len(examined.triangles) == len(triangles)


def test_defects_are_counted_and_repairs_reported() -> None:
    vertices, triangles = ball()
    turned = triangles.copy()
    turned[50] = turned[50, ::-1]
    both = np.vstack(
        [turned[1:], turned[3:4], [[7, 7, 8]]]
    )  # a hole, a repeated triangle and one without area
    examined = examine(vertices, both, "ball")
    found = examined.found
    assert (found["repeated triangles"], found["degenerate triangles"]) == (1, 1)
    assert (
        found["edges whose triangles face opposite ways"] >= 3
    )  # the three edges of the one that was turned
    assert (
        found["open edges"] >= 3 - 1
    )  # those of the hole, but for one that the triangle without area stands at
    said = " ".join(examined.done)
    for what in ("1 degenerate", "1 repeated", "same way", "closed a hole"):
        assert what in said
    assert volume(examined) == pytest.approx(BALL, rel=0.03)  # facets of 1,280 triangles take off 1.4 %


def overlapping():
    (a, triangles), (b, _) = ball(), ball((0.02, 0.0, 0.0))
    return np.vstack([a, b]), np.vstack([triangles, triangles + len(a)])


def bowl():
    vertices, triangles = ball()
    return vertices, triangles[vertices[triangles].mean(axis=1)[:, 2] < 0.4 * RADIUS]


def soup():
    """Loose triangles, each displaced a little."""
    vertices, triangles = ball()
    off = np.random.default_rng(0).normal(size=(len(triangles), 1, 3)) * 0.005 * RADIUS
    return (vertices[triangles] + off).reshape(-1, 3), np.arange(3 * len(triangles)).reshape(-1, 3)


LENS = 2 * np.pi / 12 * (4 * RADIUS + 0.02) * (2 * RADIUS - 0.02) ** 2 / 2  # what two balls 20 mm apart share
CAP = np.pi / 3 * (0.6 * RADIUS) ** 2 * (3 * RADIUS - 0.6 * RADIUS)  # what the bowl's opening leaves open


@pytest.mark.parametrize(
    ("mesh", "refusal", "expected", "rel"),
    [
        (overlapping, "pass through others", 2 * BALL - LENS, 0.03),  # facets: 1.4 %, and cells of 1.2 mm
        (
            bowl,
            "surface is open",
            BALL - CAP,
            0.03,
        ),  # a flat lid: w is 1/2 in the plane of a flat rim
        (soup, "separate pieces", BALL, 0.05),
    ],
)
def test_irreparable_meshes_are_rebuilt_by_winding_numbers(mesh, refusal, expected, rel) -> None:
    examined = examine(*mesh(), "mesh")
    assert refusal in examined.refusal
    assert "rebuilt" in examined.done[-1]
    assert volume(examined) == pytest.approx(expected, rel=rel)
    again = closed_surface(examined.vertices, examined.triangles, "again")
    assert len(again[1]) == len(examined.triangles)  # nothing left to mend
    assert not misplaced(*again).any()


def test_one_bad_face_costs_no_other_its_place() -> None:
    vertices, triangles = ball()
    # A face across the inside: its edge with the surface has three triangles.
    across = [*triangles[0, :2], int(np.argmin(vertices @ vertices[triangles[0, 0]]))]
    examined = examine(vertices, np.vstack([triangles, across]), "ball")
    assert "non-manifold" in examined.refusal
    assert examined.done == [f"removed 3 of {len(triangles) + 1} faces, and closed the holes that they left"]
    there = {tuple(corner) for corner in examined.vertices.round(9)}
    assert {tuple(corner) for corner in vertices.round(9)} <= there  # no vertex has moved
    assert volume(examined) == pytest.approx(BALL, rel=0.02)  # 1,280 flat faces take off 1.4 %
    assert not misplaced(examined.vertices, examined.triangles).any()


@pytest.mark.parametrize("normal", [[0.0, 0.0, 1.0], [1.0, 2.0, 3.0]])
def test_a_flat_drawing_is_called_flat(normal) -> None:
    vertices, triangles = ball()
    normal = np.array(normal) / np.linalg.norm(normal)
    with pytest.raises(SoftprintError, match=r"^logo: the drawing is flat"):
        examine(vertices - np.outer(vertices @ normal, normal), triangles, "logo")


def test_the_error_is_against_the_file(tmp_path) -> None:
    """A ball without a cap: what is left of it is near the rebuilt surface."""
    vertices, triangles = ball(centre=(0.1, 0.0, 0.0))
    open_ball = triangles[vertices[triangles].mean(axis=1)[:, 2] < 0.5 * RADIUS]
    trimesh.Trimesh(vertices, open_ball, process=False).export(tmp_path / "open.stl")
    _, said = run(tmp_path / "open.stl", "--resolution", "24", "--json")
    told = json.loads(said)["as a collider"]
    error = [float(part.split()[0]) for part in told["error against the file"].split(", ")[:3]]
    assert 0 < error[0] < error[1] < error[2] < 0.1 * RADIUS
    assert "stands beside its origin" in told["middle"]


def test_a_sheet_encloses_no_volume() -> None:
    vertices, triangles = ball()
    cap = triangles[vertices[triangles].mean(axis=1)[:, 2] > 0.7 * RADIUS]
    with pytest.raises(SoftprintError, match=r"^sheet: does not enclose a well-defined volume"):
        examine(vertices, cap, "sheet")


def run(*arguments: object) -> tuple[int, str]:
    parser = argparse.ArgumentParser()
    VERB.configure(parser)
    said: list[str] = []
    status = VERB.run(parser.parse_args([str(a) for a in arguments]), Context(write=said.append))
    return status, "\n".join(said)


def test_the_command_reports_everything_and_writes_a_valid_collider(tmp_path) -> None:
    vertices, triangles = bowl()
    trimesh.Trimesh(1000 * vertices, triangles, process=False).export(tmp_path / "bowl.stl")
    common = (tmp_path / "bowl.stl", "--scale", "0.001", "--resolution", "12")
    status, said = run(*common)
    assert status == 1
    assert said.endswith(
        "cannot be a collider as it is; --out MENDED.stl writes the rebuilt surface, which can."
    )
    status, said = run(*common, "--json", "--out", tmp_path / "mended.stl")
    assert status == 0
    told = json.loads(said)["as a collider"]
    assert float(told["size"].split()[0]) == pytest.approx(RADIUS, rel=0.01)  # metres; rebuilt on 64 cells
    status, said = run(tmp_path / "mended.stl", "--scale", "0.001", "--resolution", "12")
    assert status == 0
    assert "usable" in said
    assert closed_surface(*read_surface(tmp_path / "mended.stl"), "mended")
    with pytest.raises(SoftprintError, match=r"written as STL; call it mended\.stl"):
        run(*common, "--out", tmp_path / "mended.obj")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["bowl.stl", "mended.stl"]
