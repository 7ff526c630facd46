"""Whether a collider has pierced a surface, and how deep it is under its facets."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest

from softprint.runtime.arrays import Array
from softprint.runtime.colliders import Box, Placed, Plane, RigidPose, SmoothUnion, Sphere
from softprint.runtime.colliders.surface_points import surface_points
from softprint.runtime.contact.intrusion import intrusion
from softprint.runtime.contact.piercing import PiercingSearch, _Probe, depths_inside
from softprint.runtime.mesh import Mesh, box_mesh
from softprint.runtime.mesh.nearest_facets import nearest_of

SPACING = 0.01  # m, of the nodes of the block


@dataclass(frozen=True)
class Undeformed:
    """The surface of a mesh at rest, with or without a displacement of its nodes by contact; n_known: of how many
    nodes the exact positions are known before."""

    mesh: Mesh
    displacement: Array | float = 0.0
    n_known: int = 0

    @property
    def known(self):
        return (self.approximate + self.displacement)[: self.n_known]

    @property
    def approximate(self):
        return self.mesh.points[self.mesh.surface_nodes]

    def positions(self, index):
        return (self.approximate + self.displacement)[index]

    def normals(self, index):
        return self.mesh.surface_normals[index]

    def depths(self, z, near, outer):
        facets = np.searchsorted(self.mesh.surface_nodes, self.mesh.facets)
        return depths_inside(z, self.approximate + self.displacement, facets, near, outer)


@pytest.fixture
def block(dim):
    """10 cm along each edge; its surface, and the mesh."""
    mesh = box_mesh([0.0] * dim, [0.1] * dim, [10] * dim)
    return Undeformed(mesh), mesh


def at_depth(dim, depth, radius):
    """A sphere of that radius, so deep in the middle of the top."""
    centre = np.full(dim, 0.05)
    centre[-1] = 0.1 + radius - depth
    return {"ball": RigidPose(np.eye(dim), centre)}


def test_a_shallow_collider_has_not_pierced(block, dim):
    search = PiercingSearch({"ball": Sphere(0.015, dim)}, SPACING)
    assert not search.found(block[0], at_depth(dim, 0.99 * search.limit, 0.015))


def test_the_depth_agrees_with_that_in_the_cells(block, dim):
    surface, mesh = block
    ball = Sphere(0.015, dim)
    search = PiercingSearch({"ball": ball}, SPACING)
    for depth in (0.023, 0.03, 0.04):
        poses = at_depth(dim, depth, 0.015)
        found = search.found(surface, poses)["ball"]
        exact = intrusion(poses["ball"].apply(surface_points(ball)), mesh, mesh.points).depth
        # Both look at points of the ball, some millimetres apart, but not at the same ones.
        assert found.depth == pytest.approx(exact, abs=0.2 * SPACING)
        assert found.collider == "ball"
        np.testing.assert_allclose(found.point[-1], 0.1 - found.depth, atol=1e-12)


def test_a_collider_far_from_every_node_is_found(dim):
    coarse = box_mesh([0.0] * dim, [1.0] * dim, [20] * dim)
    surface = Undeformed(coarse)
    inside = {"ball": RigidPose(np.eye(dim), np.full(dim, 0.5))}
    search = PiercingSearch({"ball": Sphere(0.02, dim)}, 0.05)
    assert search.found(surface, inside)["ball"].depth > 0.4


def test_the_deepest_point_may_be_among_those_nearest_to_a_node(dim):
    """Facets of half a metre, as a dent stretches them. A rod under the top, from a node at its deepest end to the
    middle of facets, where most of its points are farther from all nodes, and not as deep."""
    block = box_mesh([0.0] * dim, [1.0] * dim, [2] * dim)
    rod, down = Box([0.125] + [0.002] * (dim - 1)), np.deg2rad(25.0)
    turn = np.eye(dim)
    turn[np.ix_([0, -1], [0, -1])] = [[np.cos(down), -np.sin(down)], [np.sin(down), np.cos(down)]]
    centre = np.full(dim, 0.5)
    centre[0], centre[-1] = 0.5 + 0.14, 0.9
    poses = {"rod": RigidPose(turn, centre)}
    search = PiercingSearch({"rod": rod}, 0.05)
    exact = intrusion(poses["rod"].apply(surface_points(rod)), block, block.points)
    found = search.found(Undeformed(block), poses)["rod"]
    # Its points are 0.05 m apart, the end's among them.
    assert found.depth == pytest.approx(exact.depth, abs=0.005)


def test_a_surface_that_gives_way_is_not_pierced(block, dim):
    surface, mesh = block
    poses = at_depth(dim, 0.03, 0.015)
    search = PiercingSearch({"ball": Sphere(0.015, dim)}, SPACING)
    assert search.found(surface, poses)
    down = -0.03 * np.eye(dim)[-1]
    top = surface.approximate[:, -1:] > 0.099
    assert not search.found(Undeformed(mesh, top * down), poses)


def test_a_collider_that_lifts_the_surface_from_inside_is_found(block, dim):
    """Above where the surface is without contact."""
    _, mesh = block
    lifted = np.where(mesh.points[mesh.surface_nodes][:, -1:] > 0.099, 0.06 * np.eye(dim)[-1], 0.0)
    search = PiercingSearch({"ball": Sphere(0.008, dim)}, SPACING)
    above = {"ball": RigidPose(np.eye(dim), np.append(np.full(dim - 1, 0.05), 0.13))}

    class Known(Undeformed):
        @property
        def known(self):
            return (self.approximate + self.displacement)[self.approximate[:, -1] > 0.099]

    found = search.found(Known(mesh, lifted), above)["ball"]
    # The top is at 0.16 m, and the ball's lowest point 0.038 m below.
    assert found.depth == pytest.approx(0.038, abs=0.1 * SPACING)


def limacon(n):
    """A limacon of Pascal, r = 1 + 2 cos t (n, 2) [m]: its inner loop, in which the curve winds twice, shows its outer
    side to the points between both loops. With outward normals (n, 2) and facets (n, 2)."""
    t = np.linspace(0.0, 2.0 * np.pi, n, endpoint=False)
    x = (1.0 + 2.0 * np.cos(t))[:, None] * np.column_stack([np.cos(t), np.sin(t)])
    tangent = np.roll(x, -1, axis=0) - np.roll(x, 1, axis=0)
    facets = np.column_stack([np.arange(n), np.roll(np.arange(n), -1)])
    return x, tangent @ np.array([[0.0, -1.0], [1.0, 0.0]]), facets


def test_what_is_inside_a_surface_that_has_folded_over():
    x, _, facets = limacon(400)
    z = np.array([[1.2, 0.0], [0.7, 0.0], [2.9, 0.0], [3.4, 0.0]])
    assert nearest_of(z[:1], x, facets).depth < 0.0
    # Chords of arcs, a hundredth long, are off by the square of that.
    expected = [0.2, 0.3, 0.1, -0.4]
    found = depths_inside(z, x, facets, np.arange(400))
    np.testing.assert_allclose(found, expected, atol=2e-3)
    # The same where the nearest node shows its outer side.
    outer = np.array([True, False, False, True])
    np.testing.assert_allclose(depths_inside(z, x, facets, np.arange(400), outer), expected, atol=2e-3)
    # Turned inside out, it winds the other way.
    np.testing.assert_allclose(
        depths_inside(z, x, facets[:, ::-1], np.arange(400)), np.abs(expected), atol=2e-3
    )


def test_the_deepest_point_may_be_on_the_outer_side_of_its_nearest_node():
    """Of two balls, one is deep inside beside the inner loop of the limacon, the other just under the outer one."""
    x, normal, facets = limacon(400)

    class Limacon:
        known, approximate = x[:0], x
        positions, normals = x.__getitem__, normal.__getitem__

        def depths(self, z, near, outer):
            return depths_inside(z, x, facets, near, outer)

    places = [np.array([1.5, 0.0]), np.array([2.85, 0.0])]
    both = SmoothUnion([Placed(Sphere(0.05, 2), RigidPose(np.eye(2), at)) for at in places], blend=0.01)
    at_rest = {"both": RigidPose(np.eye(2), np.zeros(2))}
    found = PiercingSearch({"both": both}, 0.03).found(Limacon(), at_rest)["both"]
    # The inner loop ends at (1, 0).
    assert found.depth == pytest.approx(0.55, abs=0.01)


def test_known_positions_spare_the_others(block, dim):
    """What is found does not depend on how many positions are known; where they say enough, no others are asked for."""
    surface, mesh = block
    everywhere = len(surface.approximate)
    asked = []

    class Asked(Undeformed):
        def positions(self, index):
            asked.append(index)
            return super().positions(index)

    search, depth = PiercingSearch({"ball": Sphere(0.015, dim)}, SPACING), 0.02
    poses, top = at_depth(dim, depth, 0.015), surface.approximate[:, -1:] > 0.099
    for displacement, pierced in ((0.0, True), (-depth * top * np.eye(dim)[-1], False)):
        for n_known, spared in ((0, False), (everywhere, not pierced)):
            asked.clear()
            found = search.found(Asked(mesh, displacement, n_known), poses)
            assert bool(found) == pierced
            assert bool(asked) != spared
            if pierced:
                assert found["ball"].depth == search.found(surface, poses)["ball"].depth


def test_groups_outside_are_spared_and_nothing_else_changes(block, dim, monkeypatch):
    """A bar in a dent as wide as the top of the block: with and without looking at groups of its points first."""
    surface, mesh = block
    dent = 0.05
    dented = Undeformed(mesh, -dent * (surface.approximate[:, -1:] > 0.099) * np.eye(dim)[-1])
    bar = Box(np.append(np.full(dim - 1, 0.01), 0.2), name="bar")
    search, rng = PiercingSearch({"bar": bar}, SPACING), np.random.default_rng(4)
    # Up to 3 cm from where its end is 1.5 cm deep.
    lowest = np.append(np.full(dim - 1, 0.05), 0.1 - dent - 0.015 + 0.2)
    poses = [{"bar": RigidPose(np.eye(dim), lowest + rng.uniform(-0.03, 0.03, dim))} for _ in range(20)]
    poses += [{"bar": RigidPose(turned(dim), np.full(dim, 0.05) + shift)} for shift in (0.0, 0.04)]
    shares, looked = [], _Probe.are_outside

    def are_outside(*given):
        shares.append(looked(*given).mean())
        return looked(*given)

    monkeypatch.setattr(_Probe, "are_outside", are_outside)
    found = [search.found(dented, at) for at in poses]
    assert max(shares) > 0.2
    monkeypatch.setattr(_Probe, "are_outside", lambda probe, index, *given: np.zeros(len(index), dtype=bool))
    assert [str(search.found(dented, at)) for at in poses] == [str(own) for own in found]
    assert 0 < sum(map(bool, found)) < len(found)


def turned(dim):
    """By a quarter, so that a bar lies across."""
    quarter = np.eye(dim)
    quarter[[0, -1]] = quarter[[-1, 0]] * np.array([[1.0], [-1.0]])
    return quarter


def test_colliders_beside_the_body_have_not_pierced_it(block, dim):
    """A shelf around the block, much larger than it, and balls at its corners."""
    surface, _ = block
    search = PiercingSearch({"shelf": Box(np.full(dim, 0.3)), "ball": Sphere(0.01, dim)}, SPACING)
    under = np.full(dim, 0.05)
    under[-1] = -0.3
    for corner in (np.zeros(dim), np.full(dim, 0.1)):
        outward = np.sign(corner - 0.05) / np.sqrt(dim)
        poses = {
            "shelf": RigidPose(np.eye(dim), under),
            "ball": RigidPose(np.eye(dim), corner + 0.01 * outward),
        }
        assert not search.found(surface, poses)


def test_a_half_space_never_pierces(block, dim):
    search = PiercingSearch({"floor": Plane(np.eye(dim)[-1])}, SPACING)
    here, there = RigidPose.identity(dim), RigidPose(np.eye(dim), np.full(dim, 9.0))
    assert not search.found(block[0], {"floor": here})
    assert search.hops("floor", here, there) == 1


def test_motions_are_cut_into_hops_of_the_limit(dim):
    search = PiercingSearch({"ball": Sphere(0.01, dim)}, SPACING)
    here = RigidPose.identity(dim)
    assert search.hops("ball", here, RigidPose(np.eye(dim), 0.99 * search.limit * np.eye(dim)[0])) == 1
    assert search.hops("ball", here, RigidPose(np.eye(dim), 3.5 * search.limit * np.eye(dim)[0])) == 4
