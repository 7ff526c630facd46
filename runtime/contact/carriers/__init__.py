"""Carriers: how displacements of the body at rest, such as those by its compliance, turn with the deformed body."""
