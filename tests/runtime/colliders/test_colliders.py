"""Analytic colliders and their combinations: closed-form distances, finite differences, and refusals."""

import numpy as np
import pytest
from pydantic import TypeAdapter, ValidationError

from softprint.runtime.colliders import (
    Box,
    Capsule,
    Cone,
    Cylinder,
    Placed,
    Plane,
    RigidPose,
    SmoothDifference,
    SmoothUnion,
    Sphere,
)
from softprint.runtime.colliders.build import build_collider
from softprint.runtime.colliders.kinds.registry import ColliderSpec
from softprint.runtime.errors import SoftprintError

STEP = 1e-6  # central differences of smooth functions of size one: truncation 1e-12 / R^2, round-off 1e-10

COLLIDERS = {
    "circle": Sphere(0.4, dim=2),
    "sphere": Sphere(0.4),
    "rectangle": Box([0.3, 0.4], rounding=0.1),
    "box": Box([0.3, 0.4, 0.5], rounding=0.1),
    "capsule2d": Capsule([0.0, 0.0], [0.3, 0.2], 0.2),
    "capsule": Capsule([0.0, 0.0, 0.0], [0.3, 0.2, 0.1], 0.2),
    "cone2d": Cone([-0.2, 0.0], [0.3, 0.2], 0.1, 0.2),
    "cone": Cone([-0.2, 0.0, 0.0], [0.3, 0.2, 0.1], 0.2, 0.1),
    "cylinder": Cylinder(0.3, 0.4, rounding=0.1),
    "halfplane": Plane([1.0, 2.0]),
    "plane": Plane([1.0, 2.0, 3.0]),
    "placed": Placed(Box([0.2, 0.3, 0.3]), RigidPose.from_rotation_vector([0.3, 0.4, 0.5], [0.1, 0.0, 0.1])),
    "union2d": SmoothUnion([Box([0.2, 0.3]), Placed(Sphere(0.2, 2), RigidPose(np.eye(2), [0.2, 0.2]))], 0.1),
    "union": SmoothUnion(
        [Sphere(0.3), Capsule([0, 0, 0], [0, 0, 0.5], 0.1), Cone([0, 0, 0], [0.5, 0, 0], 0.2, 0.1)], 0.1
    ),
    "union_of_cones2d": SmoothUnion(
        [Capsule([0.0, 0.0], [0.3, 0.2], 0.1), Cone([-0.3, 0], [0, 0.3], 0.1, 0.2)], 0.1
    ),
    "union_of_cones": SmoothUnion(
        [
            Capsule([-0.3, 0, 0], [0.3, 0, 0], 0.1),
            Capsule([0, -0.3, 0], [0, 0.3, 0], 0.1),
            Cone([0, 0, -0.3], [0, 0, 0.3], 0.1, 0.2),
        ],
        0.1,
    ),
    "difference": SmoothDifference(
        Box([0.4, 0.3, 0.3]), [Placed(Sphere(0.3), RigidPose(np.eye(3), [0.0, 0.1, 0.3]))], 0.1
    ),
}
every = pytest.mark.parametrize("key", list(COLLIDERS))


def points(collider, count: int = 1500):
    return np.random.default_rng(21).uniform(-0.7, 0.7, (count, collider.dim))


@every
def test_gradient_and_hessian_by_finite_differences(key):
    collider = COLLIDERS[key]
    z = points(collider)
    d = collider.sdf_derivatives(z)
    np.testing.assert_allclose(collider.sdf(z), d.value, atol=1e-14)
    gradient, hessian = np.empty_like(d.gradient), np.empty_like(d.hessian)
    for j, step in enumerate(STEP * np.eye(collider.dim)):
        gradient[:, j] = (collider.sdf(z + step) - collider.sdf(z - step)) / (2 * STEP)
        forward, backward = collider.sdf_derivatives(z + step), collider.sdf_derivatives(z - step)
        hessian[:, :, j] = (forward.gradient - backward.gradient) / (2 * STEP)
    np.testing.assert_allclose(d.gradient, gradient, atol=1e-6)
    # Hessians are compared relative to their size; a few points straddle a jump of curvature (C1, not C2).
    error = np.abs(d.hessian - hessian).max(axis=(1, 2)) / (1 + np.abs(d.hessian).max(axis=(1, 2)))
    assert np.quantile(error, 0.99) < 1e-6
    np.testing.assert_allclose(d.hessian, d.hessian.transpose(0, 2, 1), atol=1e-12)


@every
def test_derivatives_are_c1_everywhere_but_at_documented_kinks(key):
    """The gradient changes by no more than a bounded curvature times the step, inside too."""
    collider = COLLIDERS[key]
    rng = np.random.default_rng(3)
    z = points(collider, 4000)
    # Exact shapes keep the kink of their axis or centre: stay off it. It lies within a radius of 0.1.
    if key in ("circle", "sphere") or key.startswith(("capsule", "cone", "union")):
        z = z[collider.sdf(z) > -0.08]
    step = 1e-7 * rng.normal(size=z.shape)
    change = np.abs(collider.sdf_derivatives(z + step).gradient - collider.sdf_derivatives(z).gradient).max()
    assert change < 1e-4  # a curvature of 100 / m over 5e-7 m; a kink would show as a change of order one


@every
def test_gradient_is_of_unit_length_outside_and_near_the_surface(key):
    collider = COLLIDERS[key]
    d = collider.sdf_derivatives(points(collider))
    length = np.linalg.norm(d.gradient, axis=1)
    assert (length < 1 + 1e-12).all()  # never steeper than a distance
    if not key.startswith(("union", "difference")):  # blends are flatter where parts' normals disagree
        np.testing.assert_allclose(length[d.value > 0], 1.0, atol=1e-12)


@every
def test_the_solid_lies_within_its_bounds(key):
    collider = COLLIDERS[key]
    z = points(collider)
    inside = z[collider.sdf(z) < 0]
    assert len(inside) > 10
    assert ((inside >= collider.lower) & (inside <= collider.upper)).all()


def test_box_is_the_exact_rounded_box_outside_and_the_exact_box_along_its_faces():
    box = COLLIDERS["box"]
    z = points(box)
    q = np.abs(z) - (box.upper - box.rounding)
    exact = np.linalg.norm(np.maximum(q, 0), axis=1) + np.minimum(q.max(axis=1), 0) - box.rounding
    value = box.sdf(z)
    outside = exact > 0
    np.testing.assert_allclose(value[outside], exact[outside], atol=1e-14)
    # deeper: within the documented (1 - 1/sqrt(3)) R, R = rounding, and the 3/8 R of smooth_abs
    assert (value[~outside] >= exact[~outside] - 1e-14).all()
    assert (value - exact)[~outside].max() < (1 - 1 / np.sqrt(3) + 3 / 8) * box.rounding
    np.testing.assert_allclose(box.sdf(np.array([[0.25, 0.15, 0.2]])), [-0.05], atol=1e-14)


def test_cone_is_the_union_of_its_balls():
    cone = COLLIDERS["cone"]
    z = points(cone, 200)
    t = np.linspace(0, 1, 4001)[:, None, None]
    centres = (1 - t) * cone.start + t * cone.end
    radii = (1 - t[..., 0]) * cone.start_radius + t[..., 0] * cone.end_radius
    swept = (np.linalg.norm(z - centres, axis=2) - radii).min(axis=0)
    np.testing.assert_allclose(cone.sdf(z), swept, atol=1e-6)  # 4,000 balls: (length / 4000)^2 / radius


def test_cylinder_is_symmetric_about_its_axis_and_smooth_on_it():
    cylinder = COLLIDERS["cylinder"]
    z = points(cylinder, 100)
    spin = RigidPose.from_rotation_vector([0, 0, 1.1], np.zeros(3))
    np.testing.assert_allclose(cylinder.sdf(spin.apply(z)), cylinder.sdf(z), atol=1e-14)
    on_axis = cylinder.sdf_derivatives(np.array([[0.0, 0.0, 0.0], [1e-9, 0.0, 0.0]]))
    np.testing.assert_allclose(on_axis.hessian[0], on_axis.hessian[1], atol=1e-6)  # the limit along x


def test_union_and_difference_are_exact_away_from_seams():
    a, b = Sphere(0.2), Placed(Sphere(0.2), RigidPose(np.eye(3), [0.3, 0, 0]))
    z = points(a)
    sa, sb = a.sdf(z), b.sdf(z)
    apart = np.abs(sa - sb) > 0.05
    union, difference = SmoothUnion([a, b], 0.05), SmoothDifference(a, [b], 0.05)
    np.testing.assert_allclose(union.sdf(z)[apart], np.minimum(sa, sb)[apart], atol=1e-14)
    assert (np.minimum(sa, sb) - union.sdf(z)).max() <= 0.05 / 6 + 1e-14  # documented
    clear = np.abs(sa + sb) > 0.05
    np.testing.assert_allclose(difference.sdf(z)[clear], np.maximum(sa, -sb)[clear], atol=1e-14)


def test_a_difference_of_which_nothing_is_left_is_refused(dim):
    base = Sphere(0.02, dim, "base")
    SmoothDifference(base, [Sphere(0.0199, dim, "thin shell")], 1e-5)
    with pytest.raises(SoftprintError, match="collider 'nut': its parts cut all of its base away"):
        SmoothDifference(base, [Sphere(0.03, dim, "cut")], 1e-3, "nut")


@pytest.mark.parametrize("key", ["union_of_cones2d", "union_of_cones"])
def test_union_of_cones_is_what_it_is_part_by_part(key):
    """Placed parts (here with an identity pose) are not recognised as cones."""
    union = COLLIDERS[key]
    nowhere = RigidPose.identity(union.dim)
    by_part = SmoothUnion([Placed(part, nowhere) for part in union.parts], union.blend)
    z = points(union)
    for own, expected in zip(union.sdf_derivatives(z), by_part.sdf_derivatives(z), strict=True):
        # Round-off, at points as near to the middle of a ball as 1e-3.
        np.testing.assert_allclose(own, expected, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(union.sdf(z), by_part.sdf(z), atol=1e-14)


@pytest.mark.parametrize(
    ("table", "message"),
    [
        ({"shape": "box", "half_extents": [1, 1, 1], "rounding": 2}, "rounding"),
        ({"shape": "capsule", "start": [0, 0], "end": [0, 0, 1], "radius": 1}, "start and end"),
        ({"shape": "cone", "start": [0, 0], "end": [0, 1], "start_radius": 3, "end_radius": 1}, "contains"),
        ({"shape": "plane", "normal": [0, 0, 0]}, "normal"),
        ({"shape": "circle", "radius": 1, "position": [0, 0, 1]}, "needs 2 numbers"),
        ({"shape": "sphere", "radius": 1, "rotation": 0.5}, "rotation in 3D"),
        ({"shape": "mesh", "file": "nowhere.stl"}, "no such collider mesh"),
        ({"shape": "polygon", "file": "nowhere.txt"}, "no such polygon"),
        (
            {
                "shape": "union",
                "blend": 1,
                "parts": [{"shape": "circle", "radius": 1}, {"shape": "sphere", "radius": 1}],
            },
            "mixes dimensions",
        ),
    ],
)
def test_build_refuses_invalid_solids(table, message):
    with pytest.raises(SoftprintError, match=message):
        build_collider(TypeAdapter(ColliderSpec).validate_python(table))


@pytest.mark.parametrize(
    "table",
    [
        {"shape": "sphere", "radius": -1},
        {"shape": "sphere", "radius": 1, "colour": "red"},
        {"shape": "blob"},
        {"shape": "polygon"},
        {"shape": "union", "blend": 1, "parts": []},
    ],
)
def test_schema_refuses_unknown_keys_and_impossible_values(table):
    with pytest.raises(ValidationError):
        TypeAdapter(ColliderSpec).validate_python(table)


def test_build_places_parts():
    part = {"shape": "box", "half_extents": [0.1, 0.2], "position": [1.0, 2.0], "rotation": np.pi / 2}
    spec = TypeAdapter(ColliderSpec).validate_python(
        {"shape": "union", "name": "u", "blend": 0.01, "parts": [part]}
    )
    union = build_collider(spec)
    assert union.name == "u"
    assert union.dim == 2
    np.testing.assert_allclose(union.upper, [1.2, 2.1])
    np.testing.assert_allclose(union.sdf(np.array([[1.0, 2.5], [1.5, 2.0]])), [0.4, 0.3], atol=1e-12)
