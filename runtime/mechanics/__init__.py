"""Corotated linear mechanics of a body: null-space compliance, surface compliance, static condensation, corotation."""
