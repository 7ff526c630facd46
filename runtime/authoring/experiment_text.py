"""The experiment file of a body: complete, with a reason beside each choice."""

from __future__ import annotations

import json
import textwrap
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from softprint.runtime.arrays import Array
from softprint.runtime.authoring.choose_settings import DENSITY, GRAVITY, POISSON, SAG, Settings
from softprint.runtime.authoring.fidelity import Fidelity
from softprint.runtime.authoring.probe_scenes import TIMES, Probe, keyframes

RECORD, TEST = "record", "test"
_TOLD = 5e-4  # a smaller share of a surface is not worth a word


@dataclass(frozen=True)
class Sampling:
    """How many reference solutions: see `[sampling]`."""

    states: int
    places: int
    rotations: int
    depths: int = 5
    test_places: int = 0


@dataclass(frozen=True, eq=False)
class Contents:
    """What a file says. name; mesh: file; made: sentences about the mesh; cells: their number; size: extents [m];
    apart: see `Fidelity`; shapes: of the library, in space; outline: corners of the collider, in the plane; probes:
    (name, role, scene)."""

    name: str
    mesh: str
    made: list[str]
    cells: int
    size: Array
    apart: Fidelity | None
    settings: Settings
    sampling: Sampling
    seed: int
    shapes: tuple[str, ...]
    outline: Array | None
    probes: list[tuple[str, str, Probe]]


def experiment_text(contents: Contents) -> str:
    """The whole file."""
    settings, dim = contents.settings, len(contents.size)
    parts = [
        _head(contents),
        f'[experiment]\nname = "{contents.name}"\nseed = {contents.seed}',
        _body(contents, settings),
        _colliders(contents, settings),
        _contact(settings, dim),
        _sampling(contents.sampling, settings, dim),
        _training(float(contents.size.max())),
        *_scenes(contents, settings),
    ]
    return "\n\n".join(parts) + "\n"


def _head(contents: Contents) -> str:
    kind = "triangles" if len(contents.size) == 2 else "tetrahedra"
    extent = " x ".join(f"{length:.4g}" for length in contents.size)
    what = (
        f"{contents.name}: {contents.cells:,} {kind}, {extent} m, made by `softprint new`. SI units; "
        "paths are relative to "
        "this file. `softprint run` does all steps; `softprint keys` lists every key."
    )
    apart = [] if contents.apart is None else [distances(contents.apart)]
    return "\n".join([_comment(what), "#", *(_comment(f"* {line}.") for line in (*contents.made, *apart))])


def distances(apart: Fidelity) -> str:
    """How far the surfaces are from each other, of distances in metres."""
    there, back = (
        f"{1e3 * most:.2g} mm at most, {1e3 * mean:.2g} mm on average"
        for most, mean in ((apart.there_most, apart.there_mean), (apart.back_most, apart.back_mean))
    )
    buried = f" (without {apart.buried:.1%} of its area, which lies inside)" if apart.buried > _TOLD else ""
    return f"from the file's surface{buried} to the body's: {there}; from the body's to the file's: {back}"


def _body(contents: Contents, settings: Settings) -> str:
    moves = f"Under its own weight no node moves by more than {settings.sag:.1%} of the body's size"
    enough = f"stiff enough for at most {SAG:.0%}, and not softer than a firm flan, 2e4"
    sag = _comment(
        f"{moves}: {enough if settings.sag <= 1.01 * SAG else 'softer than chosen by itself, as asked for'}."
    )
    return f"""[body]
mesh = {json.dumps(str(contents.mesh), ensure_ascii=False)}

[body.handles]
points = {settings.points}                                       # more: nearer without a correction, and slower
# Held still in every scene: all nodes in this box, [lower corner, upper corner] in metres.
frames = [{{ name = "base", box = {_table(settings.hold)} }}]

[body.material]
model = "invertible_neo_hookean"
{sag}
young = {_number(settings.young)}
poisson = {POISSON}
density = {DENSITY}"""


def _colliders(contents: Contents, settings: Settings) -> str:
    size = (
        "Its size is 1.5 times the thickness of the body where it is thin, within 15 to 30 % of its "
        "middle extent, and at "
        "least three distances between its surface nodes."
    )
    if contents.outline is not None:
        corners = ",\n".join(f"    {_vector(corner)}" for corner in contents.outline)
        return f"""{_comment("A star with rounded points; another polygon may take its place. " + size)}
[[colliders]]
name = "star"
shape = "polygon"
vertices = [
{corners},
]
rounding = {_number(0.15 * settings.collider)}"""
    names = ", ".join(f'"{name}"' for name in contents.shapes)
    shapes = (
        "`size` is half of the largest extent of every shape. "
        + size
        + " Eight shapes to learn from do nearly as well as "
        'all; without `shapes`, all 52 are used. `meshes = ["my_shapes/*.stl"]` adds shapes of your own.'
    )
    return f"""{_comment(shapes)}
[library]
size = {_number(settings.collider)}
shapes = [{names}]"""


def _contact(settings: Settings, dim: int) -> str:
    gravity = ", ".join(["0"] * (dim - 1) + [f"-{GRAVITY}"])
    stiffness = (
        "At a pressure of twice Young's modulus, as under a tip, colliders penetrate by 0.65 % of their "
        "extent. A penalty "
        "that is ten times as stiff more than halves that, and takes a third more iterations."
    )
    return f"""[contact]
{_comment(stiffness)}
stiffness = {_number(settings.stiffness)}
refinement = 2                                    # contact on facets: thin limbs do not slip in between the nodes
friction = 0.0                                    # as in the truth

[dynamics]
gravity = [{gravity}]
time_step = 0.016666666666666666
max_iterations = 40"""


def _sampling(sampling: Sampling, settings: Settings, dim: int) -> str:
    of_each = "" if dim == 2 else "                                        # of each shape, and each once"
    test = "" if dim == 2 else f"\ntest_places = {sampling.test_places}"
    depth = (
        f"At most a fifth of the body's thickness where it is thin, {1e3 * settings.thickness:.3g} mm, "
        "and 0.18 sizes of a "
        "collider: deeper, there may be several solutions."
    )
    return f"""# Reference solutions: more places are more accurate, and take longer in proportion.
[sampling]
states = {sampling.states}
places = {sampling.places}{of_each}{test}
rotations = {sampling.rotations}
depths = {sampling.depths}
{_comment(depth)}
max_depth = {_number(settings.max_depth)}
repeat_share = 0.03
# Of contact places from what is held, in sizes of a shape.
frame_clearance = {settings.clearance}"""


def _training(size: float) -> str:
    # Lengths of the models relative to the Jelly's, of 0.1 m.
    lengths = f"fade_depth = {_number(0.005 * size)}\nband = {_number(0.02 * size)}"
    return f"""# Linear mechanics alone, and ours, which adds what is learned. Both lengths [m] fit the body's size.
[[training.models]]
name = "mechanics"
learned = false
{lengths}

[[training.models]]
name = "ours"
{lengths}

# Of every held-out scene, solved in full space to judge by; more take longer in proportion.
[report]
frames = 12"""


def _comment(text: str) -> str:
    """Lines of a comment."""
    return textwrap.fill(text, 116, initial_indent="# ", subsequent_indent="# ", break_long_words=False)


def _scenes(contents: Contents, settings: Settings) -> Iterable[str]:
    unseen = "shapes" if contents.outline is None else "motions"
    heads = {
        RECORD: _comment(
            "Scenes of role `record` supply the states that reference solutions are made at. In each, a "
            "collider comes to a "
            "place of the surface, leans, drags and leaves."
        )
        + "\n",
        TEST: f"# Held out: {unseen} not used in training; all models are compared here.\n",
    }
    for name, role, probe in contents.probes:
        frames = "\n".join(
            f"    {{ time = {time}, position = {_vector(position)}, rotation = {_rotation(rotation)} }},"
            for time, position, rotation in keyframes(probe, settings.pace)
        )
        duration = round((TIMES[-1] + 0.05) * settings.pace, 3)
        yield f"""{heads.pop(role, "")}[[scenes]]
name = "{name}"
role = "{role}"
duration = {duration}
kinematic = ["base"]
[[scenes.colliders]]
name = "{probe.collider}"
keyframes = [                                     # {1e3 * probe.depth:.2g} mm deep at {_vector(probe.place)}
{frames}
]"""


def _number(value: float) -> str:
    """In TOML, to three digits."""
    text = f"{value:.3g}".replace("e+0", "e").replace("e-0", "e-").replace("e+", "e")
    return text if "." in text or "e" in text else f"{text}.0"


def _vector(values: Array) -> str:
    return "[" + ", ".join(f"{value:.5f}" for value in np.asarray(values) + 0.0) + "]"


def _rotation(vector: Array) -> str:
    return f"{vector[0]:.4f}" if len(vector) == 1 else "[" + ", ".join(f"{v:.4f}" for v in vector + 0.0) + "]"


def _table(rows: Array) -> str:
    return "[" + ", ".join("[" + ", ".join(f"{x:g}" for x in row) + "]" for row in rows) + "]"
