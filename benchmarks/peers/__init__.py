"""Other simulators of soft bodies beside ours: the same mesh, material, collider and motion. See `__main__.py`."""
