"""Training data of internal corrections: the states of a truth file with their internal equilibria (thesis eq. 4.8).

r = F^-1 (x_full - U q),    or, on static condensation,    r = F^-1 (x_full - U q - u_condensed).
"""

from __future__ import annotations

import json
from dataclasses import dataclass

import numpy as np

from softprint.runtime.arrays import Array, IntArray
from softprint.runtime.body.body import ReducedBody
from softprint.runtime.body.node_gradients import basis_gradient_at_nodes
from softprint.runtime.errors import SoftprintError
from softprint.runtime.learned.internal.correction import unmapped
from softprint.runtime.learned.internal.inputs import RigidFreeRows
from softprint.runtime.mechanics.static_condensation import StaticCondensation
from softprint.runtime.truth.truth_file import TruthData

# Share of the recorded frames whose states are held out.
_HELD_OUT = 0.1


@dataclass(frozen=True, eq=False)
class InternalData:
    """inputs: z (s, n_inputs), see `inputs.py`; gravity: (dim,) [m/s^2] of the truth, empty without; fields: r (s,
    n_nodes, dim) [m]; volumes: of the nodes (n_nodes,); train, held_out: rows of these. A recorded state and its
    disturbed ones are on the same side."""

    inputs: Array
    gravity: tuple[float, ...]
    fields: Array
    volumes: Array
    train: IntArray
    held_out: IntArray


def read_internal_data(
    truth: TruthData, body: ReducedBody, condensation: StaticCondensation | None, seed: int = 0
) -> InternalData:
    """All states of a truth file. condensation: of all nodes, under the same gravity, for a correction on static
    condensation. Raises SoftprintError for too few states to hold out some, and for one in which the subspace is turned
    inside out."""
    given = json.loads(truth.header.made_from.get("dynamics.gravity", "[]"))
    gravity = tuple(map(float, given)) if any(given) else ()
    rows, gradient, encode = (
        truth.states["rows"],
        basis_gradient_at_nodes(body),
        RigidFreeRows.of(body, gravity),
    )
    fields = []
    for state, own in enumerate(rows):
        u = truth.internal(state)
        if condensation is not None:
            u = u - condensation.corotated(own).displacement(own)
        try:
            fields.append(unmapped(gradient, own, u))
        except SoftprintError as error:
            raise SoftprintError(
                f"{truth.path}: state {state}: {error}; generate states that are moved less far"
            ) from error
    frames = np.array([f"{s} {f}" for s, f in zip(truth.states["scene"], truth.states["frame"], strict=True)])
    groups, group = np.unique(frames, return_inverse=True)
    chosen = np.random.default_rng(seed).permutation(len(groups))[: round(_HELD_OUT * len(groups))]
    out = np.isin(group, chosen)
    if not out.any():
        raise SoftprintError(
            f"{truth.path}: states of {len(groups)} recorded frames are too few to hold some out: generate more"
        )
    return InternalData(
        np.array([encode(own) for own in rows]),
        gravity,
        np.array(fields),
        body.mesh.node_volumes,
        np.flatnonzero(~out),
        np.flatnonzero(out),
    )
