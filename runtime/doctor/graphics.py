"""Check whether pictures can be rendered without a display."""

from __future__ import annotations

from importlib.util import find_spec

from softprint.runtime.doctor.child import run_python
from softprint.runtime.doctor.finding import Finding, Level

_RENDER = """
import pyvista
plotter = pyvista.Plotter(off_screen=True, window_size=(64, 64))
plotter.set_background("white")
plotter.add_mesh(pyvista.Sphere(), color="red")
picture = plotter.screenshot(return_img=True)
assert picture.min() < 200 and picture.max() > 200, "the picture is empty"
print(plotter.render_window.GetClassName())
"""


def check_rendering() -> Finding:
    """Render a ball off screen."""
    subject = "off-screen OpenGL"
    if find_spec("pyvista") is None:
        return Finding(subject, Level.MISSING, "for pictures in the report", "pip install pyvista")
    result = run_python(_RENDER, {"VTK_DEFAULT_OPENGL_WINDOW": "vtkEGLRenderWindow"})
    if not result.succeeded:
        return Finding(
            subject, Level.BROKEN, result.complaint, "apt-get install libgl1 libegl1 libglu1-mesa libxrender1"
        )
    return Finding(subject, Level.OK, result.output.splitlines()[-1])
