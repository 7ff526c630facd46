"""USD (Universal Scene Description): text .usda, binary .usdc, or the package .usdz.

    /World             metres; z up, in 2D y up; one time code a frame, timeCodesPerSecond of them a second
      /body            Mesh with time samples of points, extent and normals, and of displayColor if it is coloured
      /NAME            Xform of a collider with time samples of translation and orientation
        /NAME          its Mesh; in 2D its outline as curves

The library holds a layer in memory until it is saved: 24 bytes for each vertex of the surface and each frame, and
something for its own use.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from softprint.runtime.arrays import Array, IntArray
from softprint.runtime.colliders.pose import RigidPose
from softprint.runtime.convert.frames import Frame, SurfaceMotion, in_space, pose_in_space
from softprint.runtime.drawing.colours import BODY, COLLIDER, error_colours, linear, rgb
from softprint.runtime.drawing.shading import Shading
from softprint.runtime.errors import SoftprintError
from softprint.runtime.io.files import atomic_path, temporary_beside

_BYTES = 24  # a vertex and frame: position and normal, float32
_MOST_BYTES = 4 << 30  # of a layer in memory
_FAILED = "the USD library could not write it; is the disk full?"


def write_usd(out: Path, motion: SurfaceMotion, progress: Callable[[int], None]) -> list[Path]:
    """Write OUT; returns its path."""
    needed = _BYTES * len(motion) * len(motion.nodes)
    if needed > _MOST_BYTES:
        raise SoftprintError(
            f"{out}: {len(motion)} frames of {len(motion.nodes)} vertices take {needed / 2**30:.0f} GiB of memory as "
            "USD: convert fewer with --every, --from and --to"
        )
    with atomic_path(out) as temporary:
        if out.suffix.lower() != ".usdz":
            _write_layer(temporary, motion, progress)
        else:
            from pxr import UsdUtils

            layer = temporary_beside(out.with_suffix(".usdc"))
            try:
                _write_layer(layer, motion, progress)
                if not UsdUtils.CreateNewUsdzPackage(str(layer), str(temporary), f"{out.stem}.usdc"):
                    raise OSError(_FAILED)
            finally:
                layer.unlink(missing_ok=True)
    return [out]


def _write_layer(path: Path, motion: SurfaceMotion, progress: Callable[[int], None]) -> None:
    from pxr import Tf, Usd, UsdGeom

    try:
        stage = Usd.Stage.CreateNew(str(path))
        _describe(stage, motion)
        body = _Body(stage, motion)
        solids = {
            name: _Solid(stage, name, vertices, facets) for name, (vertices, facets) in motion.solids.items()
        }
        for number, frame in enumerate(motion.frames()):
            code = Usd.TimeCode(number)
            body.sample(frame, code)
            for name, pose in frame.poses.items():
                solids[name].sample(pose, code)
            progress(1)
        world = UsdGeom.Xform.Get(stage, "/World").GetPrim()
        stage.SetDefaultPrim(world)
        if not stage.GetRootLayer().Save():
            raise OSError(_FAILED)
    except Tf.ErrorException as error:
        raise OSError(_FAILED) from error


def _describe(stage: Any, motion: SurfaceMotion) -> None:
    from pxr import UsdGeom

    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.z if motion.dim == 3 else UsdGeom.Tokens.y)
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    stage.SetTimeCodesPerSecond(motion.rate)
    stage.SetFramesPerSecond(motion.rate)
    stage.SetStartTimeCode(0)
    stage.SetEndTimeCode(len(motion) - 1)
    stage.GetRootLayer().comment = f"Softprint: {motion.source.label}, from {motion.times[0]:g} s"
    UsdGeom.Xform.Define(stage, "/World")


class _Body:
    """The mesh that deforms."""

    def __init__(self, stage: Any, motion: SurfaceMotion) -> None:
        self._top = motion.extent.top if motion.colouring is not None else 0.0
        rest = in_space(motion.rest)
        self._shading = Shading.of(rest, motion.triangles)
        self._mesh = _mesh(stage, "/World/body", rest, motion.triangles)
        self._normals = _normals(self._mesh, self._shading, rest)
        self._flat = motion.dim == 2
        self._mesh.CreateDoubleSidedAttr(self._flat)
        self._colour = self._mesh.CreateDisplayColorPrimvar(
            "vertex" if motion.colouring is not None else "constant"
        )
        if motion.colouring is None:
            self._colour.Set(_vectors(linear(rgb(BODY))[None]))
            _bind_material(stage, self._mesh, BODY, 1.0)

    def sample(self, frame: Frame, code: Any) -> None:
        points = in_space(frame.points)
        self._mesh.GetPointsAttr().Set(_vectors(points), code)
        self._mesh.GetExtentAttr().Set(_vectors(_extent(points)), code)
        if not self._flat:
            self._normals.Set(_vectors(self._shading.normals(points)), code)
        if frame.values is not None:
            self._colour.Set(_vectors(linear(error_colours(frame.values, self._top))), code)


class _Solid:
    """A rigid collider that moves."""

    def __init__(self, stage: Any, name: str, vertices: Array, facets: IntArray) -> None:
        from pxr import Tf, UsdGeom

        path = f"/World/{Tf.MakeValidIdentifier(name)}"
        if stage.GetPrimAtPath(path):
            path += "_collider"
        shape_path = (
            f"{path}/{path.rpartition('/')[2]}"  # programs that join the two keep the name of the mesh
        )
        xform = UsdGeom.Xform.Define(stage, path)
        self._translate = xform.AddTranslateOp()
        self._orient = xform.AddOrientOp()
        points = in_space(vertices)
        if facets.shape[1] == 2:
            shape = UsdGeom.BasisCurves.Define(stage, shape_path)
            shape.CreateTypeAttr(UsdGeom.Tokens.linear)
            shape.CreateCurveVertexCountsAttr([2] * len(facets))
            shape.CreatePointsAttr(_vectors(points[facets.ravel()]))
            shape.CreateWidthsAttr([0.01 * float(np.ptp(points, axis=0).max())])
            shape.SetWidthsInterpolation(UsdGeom.Tokens.constant)
            shape.CreateExtentAttr(_vectors(_extent(points)))
        else:
            shape = _mesh(stage, shape_path, points, facets)
            _normals(shape, Shading.of(points, facets), points)
        shape.CreateDisplayColorPrimvar("constant").Set(_vectors(linear(rgb(COLLIDER))[None]))
        _bind_material(stage, shape, COLLIDER, 0.4)

    def sample(self, pose: RigidPose, code: Any) -> None:
        from pxr import Gf
        from scipy.spatial.transform import Rotation

        placed = pose_in_space(pose)
        x, y, z, w = Rotation.from_matrix(placed.rotation.copy()).as_quat().tolist()
        self._translate.Set(Gf.Vec3d(*placed.translation.tolist()), code)
        self._orient.Set(Gf.Quatf(w, x, y, z), code)


def _mesh(stage: Any, path: str, points: Array, triangles: IntArray) -> Any:
    from pxr import UsdGeom

    mesh = UsdGeom.Mesh.Define(stage, path)
    mesh.CreatePointsAttr(_vectors(points))
    mesh.CreateFaceVertexCountsAttr([3] * len(triangles))
    mesh.CreateFaceVertexIndicesAttr(triangles.ravel().tolist())
    mesh.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.none)
    mesh.CreateExtentAttr(_vectors(_extent(points)))
    return mesh


def _normals(mesh: Any, shading: Shading, points: Array) -> Any:
    """Normals at the corners of the triangles, by the number of the corner: points stay shared across sharp edges."""
    from pxr import Sdf, UsdGeom, Vt

    normals = UsdGeom.PrimvarsAPI(mesh).CreatePrimvar(
        "normals", Sdf.ValueTypeNames.Normal3fArray, UsdGeom.Tokens.faceVarying
    )
    normals.Set(_vectors(shading.normals(points)))
    normals.SetIndices(Vt.IntArray(shading.triangles.ravel().tolist()))
    return normals


def _bind_material(stage: Any, shape: Any, colour: str, opacity: float) -> None:
    from pxr import Gf, Sdf, UsdShade

    path = f"{shape.GetPath()}/material"
    material = UsdShade.Material.Define(stage, path)
    shader = UsdShade.Shader.Define(stage, f"{path}/surface")
    shader.CreateIdAttr("UsdPreviewSurface")
    light = Gf.Vec3f(*linear(rgb(colour)).tolist())
    shader.CreateInput("diffuseColor", Sdf.ValueTypeNames.Color3f).Set(light)
    shader.CreateInput("roughness", Sdf.ValueTypeNames.Float).Set(0.55)
    shader.CreateInput("opacity", Sdf.ValueTypeNames.Float).Set(opacity)
    material.CreateSurfaceOutput().ConnectToSource(shader.ConnectableAPI(), "surface")
    UsdShade.MaterialBindingAPI.Apply(shape.GetPrim()).Bind(material)


def _extent(points: Array) -> Array:
    return np.stack([points.min(axis=0), points.max(axis=0)])


def _vectors(values: Array) -> Any:
    from pxr import Vt

    return Vt.Vec3fArray.FromNumpy(np.ascontiguousarray(values, dtype=np.float32))
