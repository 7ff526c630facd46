"""The contact solve: candidates, the forces that balance a collider and an elastic surface, and its warm start."""
