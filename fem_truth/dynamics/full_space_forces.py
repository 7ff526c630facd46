"""The force of a body in full space on one collider."""

from __future__ import annotations

import numpy as np

from softprint.fem_truth.dynamics.full_space_step_energy import Contact
from softprint.fem_truth.energy.surface_contact import LaggedFriction
from softprint.runtime.arrays import Array
from softprint.runtime.contact.contact_force import ContactForce, SurfaceForces, resultant


def contact_force(contact: Contact, friction: LaggedFriction | None, x: Array) -> ContactForce:
    """The force of the body on the collider: the gradient at a node of the body is the force that the body
    exerts."""
    parts = [(contact.gradient(x), False)]
    if friction is not None:
        parts.append((friction.gradient(x), True))
    forces, nodes = [], contact.nodes
    for gradient, tangential in parts:
        index = np.flatnonzero(gradient[nodes].any(axis=1))
        touched = nodes[index]
        forces.append(SurfaceForces(nodes, index, x[touched], gradient[touched], tangential))
    force, torque = resultant(forces, contact.pose.translation)
    return ContactForce(force, torque, contact.max_depth(x), len(contact.touched(x)), forces)
