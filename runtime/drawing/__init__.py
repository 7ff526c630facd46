"""Pictures of single files, off screen: PyVista for bodies in space, matplotlib for bodies in the plane.

Both are loaded only when something is drawn, so the runtime works without them.
"""
