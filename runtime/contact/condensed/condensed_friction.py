"""Friction of a contact with the detail condensed out, at the loads that bear it.

A load of `equilibrium.py` sits at y(q) = x(q) + F(q) v, v being the rest displacement of the dent. Lagged Coulomb
friction (`runtime/contact/friction.py`) holds not only the normal forces p |g| and the normals g / |g| of the last
press, but v too, so that y is affine in the handle rows q and

    D(q) = sum_j mu N_j f0(|P_j u_j|),    u_j = y_j(q) - T_end T_start^-1 y_j,start,
    dD   = sum_j f_j . dy_j,              dy = dx + dF v,

is a friction potential of the rows like any other. y_start is where the same loads were when the step began, in the
dent of that state: a dent that travels over the body slips as far as its loads do.

The dent itself stays that of frictionless contact: that tractions along the surface bend it as well is neglected, for
then a state would have to remember how it was bent. So where the contact sticks, the subspace alone follows the
collider sideways, too stiffly: a ball of 3 cm dragged over a block of 10 cm is held 1.3 (2D) to 1.8 (3D) times as
stiffly as in full space. Once it slips, the force along the path is right to 3 % at mu = 0.3, and 2 % (2D) to 15 %
(3D) too small at mu = 1. Over the held-out motion of the small Jelly at mu = 0.3 the force on the collider is 23 % off
(RMS); without friction 51 %, on the subspace alone 146 %.
"""

from __future__ import annotations

import numpy as np

from runtime.arrays import Array, RowHessian, known_hessian
from runtime.colliders.pose import Poses
from runtime.contact import CoulombFriction, FrictionTerms, LaggedContact
from runtime.contact.collider_coupling import Coupling, point_coupling
from runtime.contact.friction_state import FrictionState, SlidingNodes
from runtime.learned.correction import ContactForces
from runtime.linalg.chain_rule import through_jacobian


class CondensedFriction:
    """Between a body and colliders whose contact is condensed, by name."""

    def __init__(self, law: CoulombFriction) -> None:
        self._law = law

    def lag(self, name: str, loads: ContactForces, rows: Array, poses: Poses, step: FrictionState) -> None:
        """Let friction take up the loads found at rows, with the colliders where the step ends."""
        start = step.settled[name](loads.index)
        length = np.linalg.norm(loads.normal, axis=1)
        lagged = LaggedContact(
            index=np.arange(len(loads.index)),
            force=loads.pressure * length,
            normal=loads.normal / np.where(length > 0.0, length, 1.0)[:, None],
            anchor=poses[name].apply(step.poses[name].apply_inverse(start)),
            pose=poses[name],
        )
        step.sliding[name] = SlidingNodes(lagged, rows, loads.position, loads.moving(), loads.index)

    def terms(self, name: str, rows: Array, poses: Poses, step: FrictionState) -> FrictionTerms:
        """At the loads that were last taken up."""
        loads = step.sliding[name]
        return self._law.terms(loads.positions(rows), loads.lagged.at(poses[name]), step.time_step)

    def linearise(
        self, name: str, rows: Array, poses: Poses, step: FrictionState
    ) -> tuple[float, Array, RowHessian | None]:
        """D [J], dD/drows (n_rows, dim) [N] and its Hessian (n_rows*dim, n_rows*dim) [N/m]; no Hessian where there is
        no load."""
        terms = self.terms(name, rows, poses, step)
        if not len(terms.index):
            return 0.0, np.zeros_like(rows), None
        motion = step.sliding[name].motion.reshape(terms.gradient.size, -1)
        gradient, hessian = through_jacobian(motion, terms.gradient, terms.hessian)
        return terms.energy, gradient, known_hessian(hessian)

    def coupling(
        self, name: str, rows: Array, poses: Poses, centre: Array, step: FrictionState
    ) -> Coupling | None:
        """What a collider that moves freely about its centre (dim,) feels of it; None where there is no load."""
        terms, loads = self.terms(name, rows, poses, step), step.sliding[name]
        if not len(terms.index):
            return None
        arms = loads.positions(rows) - centre
        return point_coupling(name, arms, terms.gradient, terms.hessian, loads.motion)
