"""Experiments of a few hundred cells, in 2D and 3D, with all parts of `make demo`."""

from __future__ import annotations

from pathlib import Path

from softprint.runtime.mesh import write_mesh
from softprint.runtime.mesh.box import box_mesh

COMMON = """
[experiment]
name = "toy"
seed = 3
[body]
mesh = "box.vtu"
[body.material]
young = 2e4
poisson = 0.4
density = 1000.0
[contact]
stiffness = 1e10
[dynamics]
time_step = 0.02
gravity = GRAVITY
[sampling]
states = 3
places = 3
rotations = 2
depths = 2
max_depth = 0.006
frame_clearance = 0.0
repeat_share = 0.2
[training]
steps = 20
[training.thesis5]
steps = 50
validations = 1
[report]
frames = 1
[[training.models]]
name = "thesis5"
form = "thesis5"
encoding = "weighted_rows"
patch_inputs = false
hidden = [16, 16]
activation = "tanh"
fade = "saturating"
[[training.models]]
name = "mechanics"
learned = false
[[training.models]]
name = "ours"
hidden = [16, 16]
"""

IN_3D = """
[body.handles]
points = 6
frames = [{ name = "base", box = [[-1, -1, -1], [1, 1, 0.016]] }]
[[colliders]]
name = "ball"
shape = "mesh"
file = "ball.stl"
resolution = 16
[[scenes]]
name = "press"
role = "record"
duration = 0.4
kinematic = ["base"]
colliders = [{ name = "ball", keyframes = [
    { time = 0.0, position = [0.0, 0.0, 0.085] }, { time = 0.4, position = [0.01, 0.0, 0.072] } ] }]
[[scenes]]
name = "held_out"
role = "test"
duration = 0.3
kinematic = ["base"]
colliders = [{ name = "ball", keyframes = [
    { time = 0.0, position = [0.0, 0.02, 0.085] }, { time = 0.3, position = [0.0, 0.0, 0.075] } ] }]
"""

IN_2D = """
[body.handles]
points = 4
frames = [{ name = "base", box = [[-1, -1], [1, 0.007]] }]
[[colliders]]
name = "disc"
shape = "circle"
radius = 0.02
[[scenes]]
name = "press"
role = "record"
duration = 0.4
kinematic = ["base"]
colliders = [{ name = "disc", keyframes = [
    { time = 0.0, position = [0.0, 0.085] }, { time = 0.4, position = [0.01, 0.072] } ] }]
[[scenes]]
name = "held_out"
role = "test"
duration = 0.3
kinematic = ["base"]
colliders = [{ name = "disc", keyframes = [
    { time = 0.0, position = [0.02, 0.085] }, { time = 0.3, position = [0.0, 0.075] } ] }]
"""


def write_library_experiment(folder: Path) -> Path:
    """The block again, trained on shapes of the library for a scene with another shape."""
    experiment = write_experiment(folder, 3)
    text = experiment.read_text()
    start, end = text.index("[[colliders]]"), text.index("[[scenes]]")
    shapes = "[library]\nsize = 0.02\nresolution = 12\nshapes = ['ball', 'cushion', 'pear', 'torus']\n"
    text = text[:start] + shapes + text[end:]
    recorded, held_out = text.split('name = "held_out"')
    held_out = held_out.replace('"ball"', '"torus"').replace("0.075]", "0.062]")
    text = recorded + 'name = "held_out"' + held_out
    before, rest = text.split('[[training.models]]\nname = "thesis5"')
    text = before + rest[rest.index("[[training.models]]") :]
    text += """
[[training.models]]
name = "thesis6"
form = "thesis6"
hidden = [16, 10]
activation = "elu"
differences = 4
fade_depth = 2e-3
[training.thesis6]
steps = 50
points = 16
validations = 2
"""
    text = text.replace("places = 3", "places = 2\ntest_places = 1")
    experiment.write_text(text)
    return experiment


def write_experiment(folder: Path, dim: int) -> Path:
    """A block of a few hundred cells, and a ball read from an STL file (3D) or a disc (2D)."""
    if dim == 3:
        import trimesh

        write_mesh(folder / "box.vtu", box_mesh([-0.05, -0.05, 0.0], [0.05, 0.05, 0.06], [5, 5, 4]))
        trimesh.creation.icosphere(subdivisions=3, radius=0.02).export(folder / "ball.stl")
    else:
        write_mesh(folder / "box.vtu", box_mesh([-0.05, 0.0], [0.05, 0.06], [15, 10]))
    experiment = folder / "toy.toml"
    gravity = "[0, 0, -9.81]" if dim == 3 else "[0, -9.81]"
    experiment.write_text(COMMON.replace("GRAVITY", gravity) + (IN_3D if dim == 3 else IN_2D))
    return experiment
