"""Contact potentials between surface points and colliders: penalty and regularised Coulomb friction."""
