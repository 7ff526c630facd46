"""Pictures of single files, off screen: PyVista for 3D, matplotlib for 2D.

Both are loaded only when something is drawn, so the runtime works without them.
"""
