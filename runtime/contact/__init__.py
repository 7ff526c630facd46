"""Contact potentials between surface points and colliders: penalty and regularised Coulomb friction.

They take world positions and areas and know nothing of bodies, so reduced and full space share them. Contact of a
reduced body that gives way at its surface is in `condensed/`, and its solver in `solver/`.
"""

from softprint.runtime.contact.friction import CoulombFriction, FrictionTerms, LaggedContact
from softprint.runtime.contact.penalty import ContactTerms, PenaltyContact

__all__ = ["ContactTerms", "CoulombFriction", "FrictionTerms", "LaggedContact", "PenaltyContact"]
