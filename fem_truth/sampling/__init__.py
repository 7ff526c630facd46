"""Sampling of the truth (thesis 5.3.2): states, places, rotations and depths of contact, each sampled
independently.

Q        recorded_states   handle states of recorded dynamics, spread by farthest point without rigid motion
dX       contact_places    surface nodes, spread by geodesic distance
SO(dim)  rotations         of the collider, spread by angle
         contact_approach  where the collider comes from, and how deep it may go: not into a rigid frame
D        contact_path      depths of one contact, shallow to deep, each solve started from the previous one
"""
