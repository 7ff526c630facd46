"""Colliders as signed distances sampled on a grid and interpolated by splines."""
