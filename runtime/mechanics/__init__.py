"""Corotated linear mechanics of a body: compliance, static condensation, corotation."""
