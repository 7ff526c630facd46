"""Distance of a model's positions from the full-space ones, in the error measure of the thesis (table 5.2).

For a frame of the full-space motion with positions x, the reduced state q is its projection
(`ReducedBody.project`), and a model adds a displacement u to the reduced positions U q. Per node i,

    d_i(model) = | (U q)_i + u_i - x_i |,        d_i(bare) = | (U q)_i - x_i |,

and over a set T of frames,

    relative RMS error = sqrt( sum_{t in T} sum_i d_i(model)^2  /  sum_{t in T} sum_i d_i(bare)^2 ).

The bare subspace has 100 % by definition and the full motion 0 %. The report also prints the square of this error,
because the thesis does not say whether its percentages are of distances or of squared distances.
Everything here is plain numpy on arrays; `held_out` computes u."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass

import numpy as np

from softprint.runtime.arrays import Array, BoolArray, IntArray


def node_distances(positions: Array, full: Array) -> Array:
    """Distances d_i = |positions_i - full_i| [m]: (n,) from two (n, dim) arrays."""
    return np.linalg.norm(positions - full, axis=1)


def root_mean_square(distances: Array) -> float:
    """sqrt(mean d^2) [m]; 0 for an empty array."""
    return float(np.sqrt(np.mean(np.square(distances)))) if distances.size else 0.0


@dataclass(frozen=True)
class ModelFrames:
    """Errors of one model in a sequence of frames; every array is (n_frames,), lengths in metres.

    Sums of squares are stored instead of roots, so that frames of several scenes can be pooled exactly.
    """

    squares: Array  # sum_i d_i^2 [m^2]
    bare_squares: Array  # the same sum for the bare subspace [m^2]
    near_squares: Array  # sums over the nodes near the collider only [m^2]
    near_bare_squares: Array
    rms: Array  # root mean square over the nodes
    worst_node: Array  # max_i d_i
    bare_worst_node: Array  # the same for the bare subspace
    inverted: Array  # number of cells with det F <= 0
    max_depth: Array  # deepest surface node inside the collider
    frames: IntArray  # frame numbers in the motion

    def take(self, keep: BoolArray) -> "ModelFrames":
        """The errors on a part of the frames; keep: (n_frames,) bool."""
        return ModelFrames(**{name: getattr(self, name)[keep] for name in self.__dataclass_fields__})

    @property
    def relative(self) -> Array:
        """Relative error of each frame: the formula above for T = {t}."""
        return _root_ratio(self.squares, self.bare_squares)


@dataclass(frozen=True)
class ErrorRow:
    """One row of an error table; relative errors as fractions, lengths in metres. inverted_frames: those that show an
    inverted cell; worse_frames: those whose worst node is farther off than that of the bare subspace."""

    relative_rms: float
    relative_rms_squared: float
    relative_median: float
    relative_worst: float
    worst_frame: int
    relative_near_contact: float
    rms: float
    worst_node: float
    max_penetration: float
    mean_penetration: float
    inverted_frames: int
    worse_frames: int
    n_frames: int

    def as_dict(self) -> dict[str, float]:
        return asdict(self)


def measure_frame(
    frame: int, positions: Array, bare: Array, full: Array, near: BoolArray, depth: Array, inverted: int
) -> ModelFrames:
    """Compare a model with the full motion in one frame; `pool` joins the frames of a motion.

    positions, bare, full: (n_nodes, dim) node positions [m]; near: (n_nodes,) nodes counted as near the
    collider; depth: (n_surface,) penetration of the model's surface nodes [m]; inverted: number of cells."""
    distance, bare_distance = node_distances(positions, full), node_distances(bare, full)
    one = {
        "squares": np.square(distance).sum(),
        "bare_squares": np.square(bare_distance).sum(),
        "near_squares": np.square(distance[near]).sum(),
        "near_bare_squares": np.square(bare_distance[near]).sum(),
        "rms": root_mean_square(distance),
        "worst_node": distance.max(),
        "bare_worst_node": bare_distance.max(),
        "inverted": inverted,
        "max_depth": depth.max(initial=0.0),
    }
    arrays = {name: np.array([value], dtype=float) for name, value in one.items()}
    return ModelFrames(**arrays, frames=np.array([frame], dtype=np.int64))


def error_row(model: ModelFrames) -> ErrorRow:
    """The table row of one model over its frames (at least one)."""
    if not model.frames.size:
        raise ValueError("an error table needs at least one frame")
    relative = model.relative
    worst = int(np.argmax(relative))
    pooled = float(_root_ratio(model.squares.sum(), model.bare_squares.sum()))
    return ErrorRow(
        relative_rms=pooled,
        relative_rms_squared=pooled**2,
        relative_median=float(np.median(relative)),
        relative_worst=float(relative[worst]),
        worst_frame=int(model.frames[worst]),
        relative_near_contact=float(_root_ratio(model.near_squares.sum(), model.near_bare_squares.sum())),
        rms=float(np.sqrt(np.mean(np.square(model.rms)))),
        worst_node=float(model.worst_node.max()),
        max_penetration=float(model.max_depth.max()),
        mean_penetration=float(model.max_depth.mean()),
        inverted_frames=int((model.inverted > 0).sum()),
        worse_frames=int((model.worst_node > model.bare_worst_node).sum()),
        n_frames=int(model.frames.size),
    )


def pool(parts: Sequence[ModelFrames]) -> ModelFrames:
    """The frames of several comparisons (at least one) as one set; its error is an exact quotient of sums."""
    names = ModelFrames.__dataclass_fields__
    return ModelFrames(**{name: np.concatenate([getattr(part, name) for part in parts]) for name in names})


def error_table(models: Mapping[str, ModelFrames]) -> dict[str, dict[str, float]]:
    """`error_row` of every model, in the given order."""
    return {name: error_row(frames).as_dict() for name, frames in models.items()}


def relative_displacement_error(missed: Array, exact: Array) -> float:
    """sqrt(sum |u - u*|^2 / sum |u*|^2) of contact displacements u against exact ones u*.

    missed, exact: (n_frames,) the two sums (numerator, denominator) over the nodes in each frame [m^2]. This excludes
    what no contact correction can reproduce (inertia, the internal deformation), and compares with the label-noise
    floor.
    """
    return float(_root_ratio(missed.sum(), exact.sum()))


def evenly_spaced(candidates: IntArray, count: int) -> IntArray:
    """At most `count` of the candidates, evenly spaced, including the first and the last."""
    if len(candidates) <= count:
        return candidates
    return candidates[np.unique(np.round(np.linspace(0, len(candidates) - 1, count)).astype(int))]


def frames_to_show(
    contact: IntArray, full_depth: Array, model: ModelFrames, alone: bool = False
) -> list[tuple[int, str]]:
    """Frames for the pictures, chosen by rule: (frame, why), in order of time and without repeats.

    contact: (m,) frame numbers in contact; full_depth: (m,) depth of the collider in each of them
    [m]; model: the model whose worst frame (largest RMS distance) must be shown; alone: whether there is no collider,
    and `full_depth` is the distance of the bare subspace.
    """
    m = len(contact)
    first = "farthest from the bare subspace" if alone else "deepest contact"
    reasons = [(int(contact[np.argmax(full_depth)]), first)]
    reasons += [(int(model.frames[np.argmax(model.rms)]), "worst frame")]
    middle = "middle" if alone else "middle of the contact"
    quartiles = ((0.25, "first quartile"), (0.5, middle), (0.75, "third quartile"))
    reasons += [(int(contact[round(q * (m - 1))]), label) for q, label in quartiles]
    chosen: dict[int, list[str]] = {}
    for frame, why in reasons:
        chosen.setdefault(frame, []).append(why)
    return [(frame, ", ".join(chosen[frame])) for frame in sorted(chosen)]


def _root_ratio(numerator: Array | np.float64, denominator: Array | np.float64) -> Array:
    """sqrt(a / b), with 0 / 0 = 0."""
    a, b = np.asarray(numerator, dtype=float), np.asarray(denominator, dtype=float)
    ratio = np.divide(a, b, out=np.where(a > 0, np.inf, 0.0), where=b > 0)
    return np.sqrt(ratio)
