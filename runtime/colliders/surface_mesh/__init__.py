"""Colliders from triangle meshes: examination, repair, rebuilding, and the signed distance on a grid."""
