"""Corrections: displacement that a learned model adds to the reduced positions."""
