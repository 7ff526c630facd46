"""Training data of descriptor models: points of interest and the network inputs there (thesis 6.2.4).

Points of interest are the nodes whose reduced position is inside the collider, and, with density
exp(-phi^2 / (2 d^2)), those outside within the distance d. They are drawn by importance sampling on the size of the
displacement. Weights make sums over the drawn points unbiased estimates of sums over all nodes times that density.

Descriptors in random frames are computed once and not in every step, because they cost more than the network.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from softprint.runtime.arrays import Array, IntArray
from softprint.runtime.body.body import ReducedBody
from softprint.runtime.colliders.collider import Collider
from softprint.runtime.errors import SoftprintError
from softprint.runtime.learned.contact_patch import ContactProbe
from softprint.runtime.learned.fade import Fade
from softprint.runtime.learned.thesis6.descriptors import (
    DirectGeometry,
    LocalDescriptor,
    biased_frames,
    random_frames,
)
from softprint.runtime.learned.thesis6.descriptors.attenuation import attenuation
from softprint.runtime.learned.thesis6.descriptors.smoothed_gradient import unit_normal
from softprint.runtime.learned.thesis6.descriptors.steadiness import steadiness
from softprint.runtime.learned.thesis6.inputs import relative_rows
from softprint.runtime.learned.thesis6.model import DescriptorModelOptions
from softprint.runtime.truth.truth_file import TruthData
from softprint.surrogate.data.touching import touching_samples

# Share of the points drawn uniformly from all points of interest.
_EVEN = 0.3


@dataclass(frozen=True, eq=False)
class DescriptorData:
    """n points of s samples, each in k frames.

    descriptor: (n, k, m) [m]; relative: W(X) T^-1 (q - x) (n, n_rows, dim) [m]; rotation: R (n, k, dim, dim);
    share: (n, k) weight of each frame; factor: (n,) product of attenuation, steadiness and fade; target: (n, dim)
    [m] in collider coordinates; weight: (n,), shares of the body's volume; sample: (n,) sample of each point. Per
    sample: whole (s,), the mean squared displacement over the body [m^2], and beyond (s,), its part from nodes outside
    the descriptors' range d [m^2].
    """

    descriptor: Tensor
    relative: Tensor
    rotation: Tensor
    share: Tensor
    factor: Tensor
    target: Tensor
    weight: Tensor
    sample: Tensor
    whole: Tensor
    beyond: Tensor

    def __len__(self) -> int:
        """Number of points."""
        return len(self.factor)

    def inputs(self, index: Tensor) -> Tensor:
        """Network inputs (b, k, n_inputs) at the points `index` (b,)."""
        rotated = self.relative[index][:, None] @ self.rotation[index]
        return torch.cat([self.descriptor[index], rotated.flatten(-2)], dim=-1)

    def to(self, device: torch.device) -> DescriptorData:
        """The same data on a device."""
        return DescriptorData(*(getattr(self, field.name).to(device) for field in fields(self)))


def join_descriptor_data(parts: Sequence[DescriptorData]) -> DescriptorData:
    """Concatenate the points and samples of all parts. Raises SoftprintError if there are none."""
    if not sum(map(len, parts)):
        raise SoftprintError("in none of the requested samples does the reduced body touch the collider")
    firsts = np.cumsum([0, *(len(part.whole) for part in parts)])
    columns = {field.name: [getattr(part, field.name) for part in parts] for field in fields(DescriptorData)}
    columns["sample"] = [part.sample + int(first) for part, first in zip(parts, firsts, strict=False)]
    return DescriptorData(**{name: torch.cat(column) for name, column in columns.items()})


@dataclass(frozen=True)
class Drawing:
    """points: number per sample; frames: number of random frames per point; rng."""

    points: int
    frames: int
    rng: np.random.Generator


def load_descriptor_data(
    truth: TruthData,
    body: ReducedBody,
    collider: Collider,
    options: DescriptorModelOptions,
    samples: IntArray,
    drawing: Drawing | None,
    progress: Callable[[int], None] | None = None,
) -> DescriptorData:
    """The given rows of a truth file, all of one collider.

    With a drawing: drawn points, random frames and attenuated targets. Without: all nodes within d, the frames used at
    run time and unattenuated displacements, for measuring errors. Samples in which the reduced body has no contact
    are dropped.
    """
    probe, geometry = ContactProbe(body, collider), DirectGeometry(collider, options.radius, options.sets)
    descriptor = LocalDescriptor(body.dim, options.radius, options.samples)
    fade = Fade("saturating", options.fade_depth)
    volume = body.mesh.node_volumes / body.mesh.node_volumes.sum()
    columns: list[tuple[NDArray[np.generic], ...]] = []
    for sample, rows, pose, patch in touching_samples(truth, samples, probe, progress):
        local_rows = probe.collider_rows(rows, pose)
        u = pose.rotate_inverse(truth.displacement(sample).astype(np.float64))
        z = body.basis @ local_rows
        near, distance = collider.closer(z, options.radius)
        whole = float(volume @ np.square(u).sum(axis=1))
        beyond = whole - float(volume[near] @ np.square(u[near]).sum(axis=1))
        a = attenuation(distance, options.radius)
        weight = volume[near]
        if drawing is not None:
            u = u.copy()
            u[near] *= a[:, None]
            chosen, weight = _draw(drawing, weight * _density(distance, options.radius), u[near])
            near, a = near[chosen], a[chosen]
        z = z[near]
        gradient = geometry.smoothed(z)
        normal = unit_normal(gradient)
        if drawing is not None:
            rotation = np.stack([random_frames(normal, drawing.rng) for _ in range(drawing.frames)], axis=1)
            share = np.full(rotation.shape[:2], 1.0 / drawing.frames)
        else:
            rotation, share = _run_time_frames(normal)
        phi = [descriptor.values(geometry, z, rotation[:, k]) for k in range(rotation.shape[1])]
        relative = relative_rows(body.basis[near], local_rows, probe.affine_part, z)
        numbers = (
            np.stack(phi, axis=1),
            relative,
            rotation,
            share,
            fade.value(patch.depth) * a * steadiness(gradient),
            u[near],
            weight,
        )
        single = [np.asarray(part, dtype=np.float32) for part in numbers]
        columns.append((*single, np.full(len(near), len(columns)), np.array([whole]), np.array([beyond])))
    if not columns:
        return _empty(body, len(descriptor), 2 if drawing is None else drawing.frames)
    tensors = [torch.from_numpy(np.concatenate(column)) for column in zip(*columns, strict=True)]
    return DescriptorData(*tensors)


def _empty(body: ReducedBody, values: int, frames: int) -> DescriptorData:
    dim, empty = body.dim, torch.zeros(0)
    return DescriptorData(
        torch.zeros(0, frames, values),
        torch.zeros(0, body.n_rows, dim),
        torch.zeros(0, frames, dim, dim),
        torch.zeros(0, frames),
        empty,
        torch.zeros(0, dim),
        empty,
        empty.long(),
        empty.double(),
        empty.double(),
    )


def _density(distance: Array, radius: float) -> Array:
    """Density of points of interest: 1 inside the collider, a Gaussian of width d outside (thesis 6.2.4)."""
    return np.exp(-0.5 * np.square(np.maximum(distance, 0.0) / radius))


def _draw(drawing: Drawing, measure: Array, target: Array) -> tuple[IntArray, Array]:
    """Indices of the points drawn, and weights with which their sums estimate sums over all points times `measure`."""
    size = measure * np.linalg.norm(target, axis=1)
    p = _EVEN * measure / measure.sum()
    p += (1.0 - _EVEN) * (size / size.sum() if size.sum() > 0.0 else measure / measure.sum())
    chosen = drawing.rng.choice(len(p), size=drawing.points, p=p / p.sum())
    return chosen, measure[chosen] / (drawing.points * p[chosen])


def _run_time_frames(normal: Array) -> tuple[Array, Array]:
    """R (n, 2, dim, dim) and the weights (n, 2) of the two frames."""
    n, dim = normal.shape
    rotation, share = np.tile(np.eye(dim), (n, 2, 1, 1)), np.zeros((n, 2))
    for frames in biased_frames(normal):
        slot = (share[frames.at, 0] > 0.0).astype(int)
        rotation[frames.at, slot] = frames.rotation
        share[frames.at, slot] = frames.weight
    return rotation, share
