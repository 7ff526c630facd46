"""The terms of the total energy of a body in full space, and their sum."""
