"""Every figure of README.md and of the pages of results in docs/, with the commands that regenerate it.

    python -m tools.figures [NAME ...] [--list] [--again] [--ranks 2]

Runs what is missing or out of date, all of it or the figures named and what they need: hours in all. What the commands
of a figure print goes to runs/figures/NAME.txt, which is there only if they all succeeded; pictures go where the
documentation shows them. A figure is out of date when an experiment file, a mesh or a script that its commands name is
newer than that file, or a figure that it needs was made after it. So a run that was stopped continues where it was. The
code of the packages is not compared: after a change of it, --again runs the figures anew, without what `softprint`
itself keeps in the run directories (remove those for new reference solutions and trainings).
"""

from __future__ import annotations

import argparse
import os
import re
import subprocess
import sys
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import TextIO

REPOSITORY = Path(__file__).resolve().parent.parent
RECORDS = Path("runs") / "figures"


@dataclass(frozen=True)
class Figure:
    """commands: run one after the other in the repository; pages: where the numbers or the picture are shown; needs:
    names of figures to make before; pictures: files that the commands write."""

    commands: tuple[str, ...]
    pages: tuple[str, ...]
    needs: tuple[str, ...] = ()
    pictures: tuple[str, ...] = ()


README, RESULTS = "README.md", "docs/results.md"
CONTACT, FORCES, BODIES = (f"docs/results_{topic}.md" for topic in ("contact", "forces", "bodies"))
VIEW, TACTILE = "docs/view.md", "docs/tactile.md"
ANY, DESCRIPTOR = "docs/any_collider.md", "docs/thesis_descriptor_model.md"
_BODIES = "examples/{jelly3d,ball,finger,hand}.toml"
_SMALL = "examples/jelly_library_small.toml"
_CRUSHED = f"python -m benchmarks.press_depth {_SMALL} --shapes punch plate cone --models"
_CRUSHED += " --printed 5e-3 --deepest 0.025"
_STABLE = """--set 'body.material.model="stable_neo_hookean"'"""
_HAND = (
    "examples/hand_small.toml --set sampling.states=4 --set sampling.max_depth=0.004 --out runs/hand_states"
)
_HAND_JOINT = "--model mechanics+few --model mechanics+modes --model ours+few --model ours+modes"
_WHOLE = (
    "examples/jelly3d_small.toml --set sampling.places=64 --set sampling.rotations=30 "
    "--set training.thesis5.steps=80000 --set training.thesis5.pools=40 --set training.thesis5.validations=25 "
    "--out runs/jelly3d_whole"
)
_HAND_LBS = (
    "examples/hand_small.toml --set 'body.handles.subspace=\"linear_blend_skinning\"' "
    "--set sampling.states=1 --set sampling.places=1 --out runs/hand_lbs"
)
_JOINT = "--model mechanics+modes --model mechanics+more --model ours+modes --model ours+more"
_MODELS = "--model full --model bare --model mechanics --model ours"


def _library(name: str, options: str = "") -> Figure:
    """Table 6.1 of one body."""
    experiment = f"examples/{name}.toml"
    commands = (
        f"softprint generate {experiment}{options}",
        f"softprint train {experiment}{options}",
        f"softprint simulate {experiment}{options} {_MODELS}",
        f"softprint report {experiment}{options}",
    )
    return Figure(commands, (BODIES,))


def _motions(experiment: str, scene: str, needs: str, run: str) -> Figure:
    """One line of the table of where it fails."""
    motions = " ".join(f"runs/{run}/motions/{scene}_{model}.h5" for model in ("full", "ours", "bare"))
    out = "" if run == experiment else f" --out runs/{run}"
    commands = (
        f"softprint simulate examples/{experiment}.toml{out} {_MODELS}",
        f"softprint report examples/{experiment}.toml{out}",
        f"python -m benchmarks.motions_alone {motions}",
    )
    return Figure(commands, (BODIES,), (needs,))


def _whole(experiment: str, scene: str, page: str, options: str = "") -> Figure:
    """A small body from its truth to its motions alone."""
    models = ("full", "bare", "mechanics", "ours")
    motions = " ".join(f"runs/{experiment}/motions/{scene}_{model}.h5" for model in models)
    run = f"softprint run examples/{experiment}.toml{options}"
    return Figure((run, f"python -m benchmarks.motions_alone {motions}"), (page,))


# Those that touch the body in the scene.
_SHAPES_ALONE = {
    "push": (
        *("egg", "boulder", "spring", "slab", "bone", "torus", "mug", "cluster", "octahedron", "bolt"),
        *("dodecahedron", "nut", "starfish", "key", "truss", "hills"),
    ),
    "press": ("boulder", "spring", "mug", "cluster", "octahedron", "bolt", "truss", "hills"),
}


def _alone(scene: str, shape: str) -> tuple[str, str]:
    """One line of the table of forces in motions: a shape of the library in a recorded scene."""
    motion = f"runs/jelly_library_small/motions/{scene}_with_{shape}_stand_in"
    return (
        f"softprint simulate {_SMALL} --scene {scene} --collider {shape} --model full --model mechanics --model ours",
        f"python -m benchmarks.motions_alone {motion}_full.h5 {motion}_mechanics.h5 {motion}_ours.h5",
    )


def _refined(points: int) -> tuple[str, ...]:
    """The motions of `_alone` and those held out, in full space with so many points along an edge of a facet."""
    play = f"softprint simulate {_SMALL} --set contact.refinement={points} --out runs/library_refinement_{points}"
    alone = (
        f"{play} --model full --scene {scene} --collider {shape}"
        for scene, shapes in _SHAPES_ALONE.items()
        for shape in shapes
    )
    return (f"{play} --model full", *alone)


_PRESSED = "--shapes punch ball cone blunt_cone plate --places 5 --processes 2"
_PLACES = f"{_SMALL} --set sampling.places=42 --set sampling.max_depth=0.0055 --out runs/library_42"
_FINE_JELLY = (
    """examples/jelly3d.toml --out runs/jelly3d_fine --set 'body.mesh="../runs/jelly3d_fine.vtu"' """
    "--set sampling.places=16 --set sampling.rotations=4"
)
#: In an order in which each comes after what it needs.
FIGURES: Mapping[str, Figure] = {
    "demo": Figure(("make demo",), (README, RESULTS), pictures=("runs/jelly3d_small/report.html",)),
    "motion_strip": Figure(
        ("python tools/motion_strip.py examples/jelly3d_small.toml",),
        (README, RESULTS),
        ("demo",),
        pictures=("docs/motion_strip.png",),
    ),
    "press_gif": Figure(
        (
            "softprint convert runs/jelly3d_small/motions/held_out_ours.h5 docs/press.gif --from 0.2 --to 1.7 "
            "--rate 15 --width 480 --colour displacement",
        ),
        (README, RESULTS),
        ("demo",),
        pictures=("docs/press.gif",),
    ),
    "view": Figure(
        ("python -m tools.view_screenshot examples/jelly3d_small.toml docs/view.png",),
        (README, RESULTS),
        ("demo",),
        pictures=("docs/view.png",),
    ),
    "viewer_speed": Figure(
        (
            "softprint body examples/jelly3d.toml",
            "softprint generate examples/jelly3d.toml --set sampling.places=16 --set sampling.rotations=5",
            "softprint train examples/jelly3d.toml --set sampling.places=16 --set sampling.rotations=5 --model ours",
            "python -m benchmarks.viewer_speed examples/jelly3d.toml",
            "python -m benchmarks.viewer_speed examples/jelly3d_small.toml --browser",
            "python -m benchmarks.viewer_speed examples/jelly3d.toml --browser",
            "python meshes/jelly.py --dim 3 --edge-length 0.00069 --inside 0.0085 --out runs/jelly3d_fine.vtu",
            f"softprint body {_FINE_JELLY}",
            f"softprint generate {_FINE_JELLY}",
            f"softprint train {_FINE_JELLY} --model ours",
            "python -m benchmarks.viewer_speed examples/jelly3d.toml --out runs/jelly3d_fine "
            """--set 'body.mesh="../runs/jelly3d_fine.vtu"'""",
        ),
        (VIEW,),
        ("demo",),
    ),
    "gel_pad": Figure(
        (
            "softprint generate examples/gel_pad_small.toml",
            "softprint train examples/gel_pad_small.toml",
            "softprint simulate examples/gel_pad_small.toml --model full --model bare --model mechanics --model ours",
            "softprint report examples/gel_pad_small.toml",
            "softprint touch examples/gel_pad_small.toml --scene turned_bar --markers 12x9 --model full "
            "--model mechanics --model ours",
            "cp runs/gel_pad_small/touch/turned_bar_full_mechanics_ours_camera.png docs/tactile.png",
        ),
        (README, RESULTS, "docs/tactile.md"),
        pictures=("docs/tactile.png",),
    ),
    "gel_pad_12": Figure(
        (
            "softprint run examples/gel_pad_small.toml --set sampling.states=1 --set sampling.places=12 "
            "--out runs/pad_12",
        ),
        (TACTILE,),
    ),
    "tactile": Figure(
        (
            "python -m benchmarks.gel_locking",
            "python -m benchmarks.tactile_environment --episodes 3",
            "python -m benchmarks.tactile_views runs/gel_pad_small/touch/turned_bar_full_camera.h5 "
            "runs/gel_pad_small/touch/turned_bar_mechanics_camera.h5 "
            "runs/gel_pad_small/touch/turned_bar_ours_camera.h5",
        ),
        (TACTILE,),
        ("gel_pad",),
    ),
    "metamaterials": Figure(
        (
            "softprint run examples/accordion_small.toml",
            "softprint run examples/auxetic_small.toml",
            "python -m reproduction.metamaterials examples/accordion_small.toml",
            "python -m reproduction.metamaterials examples/auxetic_small.toml",
            "python -m benchmarks.learned_cubature examples/auxetic_small.toml",
            "python -m reproduction.reentrant_cell",
        ),
        (RESULTS, "docs/internal_corrections.md"),
    ),
    "modes_in_equilibrium": Figure(
        (
            "softprint generate examples/hand_alone_small.toml",
            "softprint train examples/hand_alone_small.toml",
            "python -m reproduction.internal_forces examples/hand_alone_small.toml",
            "python -m reproduction.internal_forces examples/hand_alone_small.toml --all-cells --states 8",
            "python -m reproduction.metamaterials examples/hand_alone_small.toml --tables motion --steps 60",
            "softprint generate examples/accordion_small.toml --set sampling.states=150 --out runs/accordion_few",
            "softprint train examples/accordion_small.toml --set sampling.states=150 --out runs/accordion_few",
            "python -m reproduction.metamaterials examples/accordion_small.toml --out runs/accordion_few "
            "--tables statics motion",
            "softprint generate examples/auxetic_small.toml --set sampling.states=150 --out runs/auxetic_few",
            "softprint train examples/auxetic_small.toml --set sampling.states=150 --out runs/auxetic_few",
            "python -m reproduction.metamaterials examples/auxetic_small.toml --out runs/auxetic_few --tables statics",
        ),
        ("docs/internal_corrections.md",),
    ),
    "meshers": Figure(("python -m benchmarks.meshers --cells 5000",), ("docs/own_mesh.md",)),
    "demo_2d": _whole("jelly2d", "held_out", RESULTS, " --set sampling.rotations=8"),
    "collider_library": Figure(
        ("python meshes/library_sheet.py docs/collider_library.png",),
        (README, RESULTS),
        pictures=("docs/collider_library.png",),
    ),
    "drop": Figure(
        (
            "softprint body examples/falling3d_small.toml",
            "softprint simulate examples/falling3d_small.toml --model bare",
            "softprint inspect runs/falling3d_small/motions/drop_bare.h5 --frame 30 --png docs/drop.png",
        ),
        (README, RESULTS),
        pictures=("docs/drop.png",),
    ),
    "verify": Figure(("softprint verify",), (RESULTS,)),
    "speed_small": Figure(("softprint bench examples/jelly3d_small.toml --cores 2",), (README,), ("demo",)),
    "speed": Figure((f"python -m benchmarks.bodies_speed {_BODIES} --no-full --cores 2",), (RESULTS,)),
    "speed_one_core": Figure((f"python -m benchmarks.bodies_speed {_BODIES} --no-full",), (RESULTS,)),
    "first_step": Figure(("python -m benchmarks.first_step",), (RESULTS,)),
    "truth_scale": Figure(("python -m benchmarks.truth_scale",), (RESULTS,)),
    "contact_points": Figure(
        (
            "python -m benchmarks.contact_points examples/jelly3d_small.toml --contacts 40 --refinements 0 2 4 "
            "--stiffness 0.1 1 10",
        ),
        (CONTACT,),
        ("demo",),
    ),
    "ipc_witness": Figure(
        ("python -m pip install --quiet ipctk==1.6.1", "python -m benchmarks.ipc_witness"), (CONTACT,)
    ),
    "barrier_motion": Figure(
        (
            "softprint simulate examples/jelly3d_small.toml --out runs/barrier --model full --set contact.friction=0 "
            "--set 'contact.model=\"barrier\"'",
            "softprint simulate examples/jelly3d_small.toml --out runs/facets --model full --set contact.friction=0 "
            "--set contact.refinement=2 --set contact.stiffness=3e12",
        ),
        (CONTACT,),
    ),
    "friction": Figure(("python -m benchmarks.dragged_ball",), (CONTACT,)),
    "motions_alone": Figure(
        (
            "python -m benchmarks.motions_alone runs/jelly3d_small/motions/held_out_full.h5 "
            "runs/jelly3d_small/motions/held_out_bare.h5 runs/jelly3d_small/motions/held_out_mechanics.h5 "
            "runs/jelly3d_small/motions/held_out_ours.h5 runs/jelly3d_small/motions/held_out_thesis5.h5",
        ),
        (RESULTS,),
        ("demo",),
    ),
    "drop_map": Figure(
        ("python -m benchmarks.drop_map examples/jelly3d_small.toml --plot docs/drop_map.png",),
        (RESULTS,),
        ("demo",),
        pictures=("docs/drop_map.png",),
    ),
    "bounces": Figure(
        ("python -m benchmarks.drop_map examples/jelly3d_small.toml --bounces",), (CONTACT,), ("demo",)
    ),
    "correction_inertia": Figure(
        ("python -m benchmarks.correction_inertia examples/jelly3d_small.toml",), (CONTACT,), ("demo",)
    ),
    "free_bodies": Figure(
        (
            "softprint body examples/falling3d_small.toml",
            "softprint generate examples/falling3d_small.toml",
            "softprint train examples/falling3d_small.toml",
            "softprint body examples/cube_small.toml",
            "python -m benchmarks.free_bodies examples/falling3d_small.toml examples/cube_small.toml",
        ),
        (RESULTS,),
    ),
    "random_scenes": Figure(
        (
            "python -m benchmarks.random_scenes examples/jelly3d_small.toml --steps 57000",
            "softprint body examples/jelly2d_star_small.toml",
            "python -m benchmarks.random_scenes examples/jelly2d_star_small.toml --steps 1000000",
        ),
        (CONTACT,),
        ("demo",),
    ),
    "cubature": Figure(("python -m benchmarks.cubature",), ("docs/method.md",)),
    "near_colliders": Figure(
        ("python -m reproduction.near_colliders runs/jelly3d_small/body.h5",), ("docs/method.md",), ("demo",)
    ),
    "ranks_per_solve": Figure(
        ("python -m benchmarks.ranks_per_solve --sizes 15000 60000 500000 --ranks 1 2 4",),
        ("docs/large_runs.md",),
    ),
    "jelly_library_small": Figure(
        (
            f"softprint generate {_SMALL}",
            f"softprint train {_SMALL}",
            f"softprint simulate {_SMALL} --model full --model bare --model ours --model thesis6",
            f"softprint report {_SMALL}",
        ),
        (ANY, RESULTS),
    ),
    "thesis6_places": Figure(
        (
            f"softprint generate {_PLACES}",
            f"softprint train {_PLACES} --set training.thesis6.steps=30000 --model thesis6",
            f"softprint simulate {_PLACES} --model full",
            f"softprint report {_PLACES} --set training.thesis6.steps=30000",
        ),
        (DESCRIPTOR,),
    ),
    "peers": Figure(
        (
            "python -m pip install --quiet --no-deps -r constraints/peers.txt",
            "python -m benchmarks.peers --plot docs/peers.png",
            "python -m benchmarks.peers --laws",
        ),
        (RESULTS,),
        ("jelly_library_small",),
        ("docs/peers.png",),
    ),
    "press_depth": Figure(
        (f"python -m benchmarks.press_depth {_SMALL} {_PRESSED} --models bare mechanics ours",),
        (CONTACT,),
        ("jelly_library_small",),
    ),
    "crushed_cells": Figure(
        (
            _CRUSHED,
            f"{_CRUSHED} {_STABLE}",
            "python meshes/jelly.py --dim 3 --edge-length 0.0018 --inside 0.0085 --out runs/jelly3d_2mm.vtu",
            f"""{_CRUSHED} --set 'body.mesh="../runs/jelly3d_2mm.vtu"'""",
            f"""{_CRUSHED} {_STABLE} --set 'body.mesh="../runs/jelly3d_2mm.vtu"'""",
        ),
        (CONTACT,),
    ),
    "energy_labels": Figure(
        (f"python -m reproduction.energy_labels {_SMALL} --seeds 3",), (FORCES,), ("jelly_library_small",)
    ),
    "force_floor": Figure(
        (f"python -m benchmarks.force_floor {_SMALL} --samples 60 --models ours",),
        (FORCES,),
        ("jelly_library_small",),
    ),
    "handle_forces": Figure(
        (f"python -m benchmarks.handle_forces {_SMALL}",), (FORCES,), ("jelly_library_small",)
    ),
    "random_scenes_ours": Figure(
        (f"python -m benchmarks.random_scenes {_SMALL} --model ours --steps 10000",),
        (CONTACT,),
        ("jelly_library_small",),
    ),
    "motions_of_shapes": Figure(
        tuple(
            command
            for scene, shapes in _SHAPES_ALONE.items()
            for shape in shapes
            for command in _alone(scene, shape)
        ),
        (FORCES,),
        ("jelly_library_small",),
    ),
    "reference_floor_motions": Figure(
        (
            f"python -m benchmarks.reference_floor_motions {_SMALL} "
            "runs/jelly_library_small/motions/{push,press}_with_*_full.h5 "
            "runs/jelly_library_small/motions/{held_out,pointy}_full.h5",
        ),
        (FORCES,),
        ("motions_of_shapes",),
    ),
    "contact_quadrature": Figure(
        (
            *_refined(4),
            *_refined(8),
            "python -m benchmarks.contact_quadrature runs/jelly_library_small/motions/{push,press}_with_*_full.h5 "
            "runs/jelly_library_small/motions/{held_out,pointy}_full.h5 "
            "--finer runs/library_refinement_4 runs/library_refinement_8",
        ),
        (FORCES,),
        ("motions_of_shapes",),
    ),
    "forces_along_motions": Figure(
        (
            f"python -m benchmarks.forces_along_motions {_SMALL} "
            "runs/jelly_library_small/motions/{push,press}_with_*_full.h5 "
            "runs/jelly_library_small/motions/{held_out,pointy}_full.h5",
        ),
        (FORCES,),
        ("motions_of_shapes",),
    ),
    "carriers": Figure(
        (
            f"python -m reproduction.linear_response {_SMALL} push=slab push=octahedron push=mug push=key",
            "python -m reproduction.linear_response examples/jelly3d_small.toml held_out",
        ),
        ("docs/method.md",),
        ("motions_of_shapes", "demo"),
    ),
    "thin_shapes": Figure(
        (
            "python -m benchmarks.thin_shapes examples/jelly_library_small.toml",
            "python -m benchmarks.thin_shapes examples/jelly_library_small.toml --models mechanics "
            '--shapes comb "plate, across" needle --picture docs/thin_shapes.png',
            "python -m benchmarks.reference_floor examples/jelly_library_small.toml",
        ),
        (RESULTS,),
        ("jelly_library_small",),
        pictures=("docs/thin_shapes.png",),
    ),
    "superposition": Figure(
        (
            "softprint run examples/jelly2d_circle_small.toml",
            "python -m reproduction.superposition examples/jelly2d_circle_small.toml --components 50 --widths 100 100 "
            "--picture docs/superposition.png",
        ),
        ("docs/chapters_4_and_5.md",),
        pictures=("docs/superposition.png",),
    ),
    "hat": Figure(
        (
            f"softprint simulate examples/hat_small.toml --out runs/jelly_library_small {_MODELS}",
            "python -m reproduction.limit_case examples/hat_small.toml --out runs/jelly_library_small --frames 8 "
            "--picture docs/hat.png",
        ),
        (RESULTS, ANY),
        ("jelly_library_small",),
        ("docs/hat.png",),
    ),
    "how_much_truth": Figure(
        (
            f"python -m reproduction.how_much_truth {_SMALL} --steps 800 --seeds 2 "
            "--plot docs/how_much_truth.png",
        ),
        (RESULTS, "docs/training_data.md"),
        ("jelly_library_small",),
        ("docs/how_much_truth.png",),
    ),
    "inputs": Figure(
        (f"python -m reproduction.force_inputs_ablation {_SMALL} --every 6 --steps 400 --seeds 1",),
        (ANY,),
        ("jelly_library_small",),
    ),
    "thesis6_ablation": Figure(
        (f"python -m reproduction.thesis6_ablation {_SMALL} --steps 1000 --seeds 3",),
        (RESULTS, DESCRIPTOR),
        ("jelly_library_small",),
    ),
    "descriptor_ways": Figure(
        (f"python -m reproduction.descriptor_ways {_SMALL} --colliders caltrop star_fruit burr --steps 40",),
        (RESULTS, DESCRIPTOR),
        ("jelly_library_small",),
    ),
    "thesis6_figures": Figure(
        (f"python -m reproduction.thesis6_figures {_SMALL} --steps 20 --plot docs/thesis6_figures.png",),
        (RESULTS, DESCRIPTOR),
        ("thesis6_ablation", "descriptor_ways"),
        ("docs/thesis6_figures.png",),
    ),
    "jelly_library": _library("jelly_library", " --set sampling.places=6 --set sampling.test_places=3"),
    "ball": _library("ball", " --set sampling.states=1 --set sampling.places=12"),
    "finger": _library("finger"),
    "hand": _library("hand"),
    "table_6_1": Figure(
        ("softprint gather runs/jelly_library runs/ball runs/finger runs/hand",),
        (BODIES,),
        ("jelly_library", "ball", "finger", "hand"),
    ),
    "motions_jelly": _motions("jelly_library", "held_out", "jelly_library", "jelly_library"),
    "motions_ball": _motions("ball", "bars", "ball", "ball"),
    "motions_finger": _motions("finger", "read", "finger", "finger"),
    "motions_hand": _motions("hand", "explore", "hand", "hand"),
    "ball_small": _whole("ball_small", "bars", BODIES),
    "ball_confidence": Figure(
        ("python -m reproduction.confidence_check examples/ball_small.toml --calibrate bars --judge bars",),
        (BODIES,),
        ("ball_small",),
    ),
    "ball_on_modes": Figure(
        (
            "softprint generate examples/ball_alone_small.toml",
            "softprint train examples/ball_alone_small.toml",
            "mkdir -p runs/ball_small/internal",
            "cp runs/ball_alone_small/internal/*.safetensors runs/ball_small/internal",
            f"softprint simulate examples/ball_small.toml {_JOINT}",
            "python -m benchmarks.motions_alone runs/ball_small/motions/bars_"
            "{full,bare,mechanics,mechanics+modes,mechanics+more,ours,ours+modes,ours+more}.h5",
            f"softprint bench examples/ball_small.toml --model mechanics --model ours {_JOINT}",
        ),
        ("docs/internal_corrections.md",),
        ("ball_small",),
    ),
    "ball_quadratic": Figure(
        (
            "softprint run examples/ball_forces_small.toml",
            "python -m reproduction.internal_forces examples/ball_forces_small.toml",
            "mkdir -p runs/ball_small/internal",
            "cp runs/ball_forces_small/internal/*.safetensors runs/ball_small/internal",
            "softprint simulate examples/ball_small.toml --model mechanics+quadratic",
            "python -m benchmarks.motions_alone runs/ball_small/motions/bars_"
            "{full,bare,mechanics,mechanics+quadratic}.h5",
            "softprint bench examples/ball_small.toml --model mechanics --model mechanics+quadratic",
        ),
        ("docs/internal_corrections.md",),
        ("ball_small",),
    ),
    "ball_forces": Figure(
        (
            "python -m reproduction.linear_response examples/ball_small.toml bars --frames 8",
            "python -m reproduction.internal_forces examples/ball_small.toml --states 10",
        ),
        (BODIES,),
        ("ball_small",),
    ),
    "contacts_to_learn_from": Figure(
        (
            "softprint run examples/hand_small.toml --set sampling.states=4 --set sampling.places=4 "
            "--out runs/hand_s4",
        ),
        (BODIES,),
    ),
    "finger_small": _whole("finger_small", "read", BODIES),
    "step_tolerance": Figure(
        (
            f"python -m benchmarks.step_tolerance {_SMALL} pointy",
            "python -m benchmarks.step_tolerance examples/finger_small.toml read",
            "python -m benchmarks.step_tolerance examples/ball_small.toml bars",
        ),
        (RESULTS,),
        ("jelly_library_small", "ball_small", "finger_small"),
    ),
    "thesis5_whole": Figure(
        (
            f"softprint generate {_WHOLE}",
            f"softprint train {_WHOLE} --model thesis5",
            f"softprint simulate {_WHOLE} --model full --model bare --model thesis5",
            f"softprint report {_WHOLE}",
            "python -m benchmarks.motions_alone runs/jelly3d_whole/motions/held_out_{full,bare,thesis5}.h5",
        ),
        ("docs/thesis_field_model.md",),
        (),
    ),
    "eigenfrequencies": Figure(
        ("python -m benchmarks.eigenfrequencies examples/{jelly3d_small,finger_small,ball_small}.toml",),
        ("docs/method.md",),
        ("demo", "finger_small", "ball_small"),
    ),
    "press_over_bone": Figure(
        (
            "python -m benchmarks.press_depth examples/finger_small.toml --shapes bead --place 0.012 0 "
            "--deepest 0.0105 --printed 1e-3 --models mechanics ours",
        ),
        (CONTACT,),
        ("finger_small",),
    ),
    "hand_small": _whole("hand_small", "explore", BODIES),
    "forces_on_the_mug": Figure(
        (
            "python -m benchmarks.forces_along_motions examples/hand_small.toml "
            "runs/hand_small/motions/explore_full.h5",
        ),
        (BODIES,),
        ("hand_small",),
    ),
    "hand_lbs": Figure(
        (
            f"softprint generate {_HAND_LBS}",
            f"softprint train {_HAND_LBS} --model mechanics",
            f"softprint simulate {_HAND_LBS} --model bare --model condensed --model mechanics",
            "python -m benchmarks.motions_alone runs/hand_small/motions/explore_full.h5 "
            "runs/hand_lbs/motions/explore_{bare,condensed,mechanics}.h5",
            "softprint simulate examples/hand_small.toml --model condensed",
            "python -m benchmarks.motions_alone runs/hand_small/motions/explore_{full,bare,condensed,mechanics}.h5",
        ),
        (BODIES,),
        ("hand_small",),
    ),
    "hand_on_modes": Figure(
        (
            f"softprint run {_HAND}",
            "mkdir -p runs/hand_states/internal",
            "cp runs/hand_alone_small/internal/*.safetensors runs/hand_states/internal",
            f"softprint simulate {_HAND} {_HAND_JOINT}",
            "python -m benchmarks.motions_alone runs/hand_states/motions/explore_"
            "{full,bare,mechanics,mechanics+few,mechanics+modes,ours,ours+few,ours+modes}.h5",
            f"softprint bench {_HAND} --steps 60 --model mechanics --model ours {_HAND_JOINT}",
        ),
        ("docs/internal_corrections.md",),
        ("modes_in_equilibrium",),
    ),
    "hand_full": Figure(
        (
            "softprint body examples/hand.toml",
            "softprint simulate examples/hand.toml --model full --scene explore",
        ),
        (RESULTS,),
    ),
    "motions_hat": _motions("hat_small", "hat", "hat", "jelly_library_small"),
}


def named_files(command: str, root: Path) -> set[Path]:
    """Experiment files that a command names, meshes that they name, and scripts and modules of this repository: what
    its output depends on besides the packages. Braces are expanded as the shell does."""
    found: set[Path] = set()
    for word in command.split():
        for path in _expanded(word.rpartition("=")[2]):
            if path.startswith("examples/") and path.endswith(".toml"):
                text = (root / path).read_text(encoding="utf-8")
                found |= {root / path}
                found |= {root / "meshes" / file for file in re.findall(r'"\.\./meshes/([\w.]+)"', text)}
            elif path.endswith(".py"):
                found.add(root / path)
            elif re.fullmatch(r"(benchmarks|reproduction)\.\w+", path):
                module = root / path.replace(".", "/")
                found |= set(module.glob("*.py")) if module.is_dir() else {module.with_suffix(".py")}
    return found


def _expanded(word: str) -> list[str]:
    parts = [part.split(",") for part in re.split(r"[{}]", word)] if "{" in word else [[word]]
    return ["".join(chosen) for chosen in product(*parts)]


class Records:
    """What has been made, as files in runs/figures of a repository."""

    def __init__(self, root: Path, figures: Mapping[str, Figure] = FIGURES) -> None:
        self.root, self.figures = root, figures

    def path(self, name: str) -> Path:
        """Of what the commands of a figure printed."""
        return self.root / RECORDS / f"{name}.txt"

    def state(self, name: str) -> str:
        """made, missing or out of date."""
        figure, path = self.figures[name], self.path(name)
        pictures = [self.root / picture for picture in figure.pictures]
        if not path.is_file() or not all(picture.is_file() for picture in pictures):
            return "missing"
        sources = set().union(*(named_files(command, self.root) for command in figure.commands))
        sources |= {self.path(needed) for needed in figure.needs}
        made = path.stat().st_mtime_ns
        newer = any(source.is_file() and source.stat().st_mtime_ns > made for source in sources)
        stale = any(self.state(needed) != "made" for needed in figure.needs)
        return "out of date" if newer or stale else "made"

    def with_needs(self, names: Sequence[str]) -> list[str]:
        """These figures and all that they need, each after what it needs."""
        wanted = set(names)
        for name in reversed(list(self.figures)):
            if name in wanted:
                wanted |= set(self.figures[name].needs)
        return [name for name in self.figures if name in wanted]

    def make(self, name: str, ranks: int) -> bool:
        """Run the commands of a figure; whether all of them succeeded."""
        path = self.path(name)
        path.parent.mkdir(parents=True, exist_ok=True)
        partial = path.with_suffix(".partial")
        began = time.monotonic()
        with partial.open("w", encoding="utf-8") as record:
            record.write(f"version {_version(self.root)}\n")
            for command in self.figures[name].commands:
                record.write(f"\n$ {command}\n")
                record.flush()
                if not self._run(shell_line(command, ranks), record):
                    print(f"{name}: `{command}` failed; what it printed is in {partial}", file=sys.stderr)
                    return False
            record.write(f"\n{time.monotonic() - began:.0f} s\n")
        partial.replace(path)
        return True

    def _run(self, line: str, record: TextIO) -> bool:
        environment = {
            **os.environ,
            "PATH": f"{Path(sys.executable).parent}{os.pathsep}{os.environ.get('PATH', '')}",
            "PYTHONPATH": str(self.root),
        }
        if hasattr(os, "geteuid") and os.geteuid() == 0:  # Open MPI wants to be told twice
            environment |= {"OMPI_ALLOW_RUN_AS_ROOT": "1", "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM": "1"}
        with subprocess.Popen(
            ["bash", "-c", line],
            cwd=self.root,
            env=environment,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        ) as process:
            assert process.stdout is not None
            for printed in process.stdout:
                print(printed, end="", flush=True)
                record.write(printed)
        return process.returncode == 0


def shell_line(command: str, ranks: int) -> str:
    """The command as it is run: reference solutions on several ranks, training and reports on all cores."""
    if command.startswith("softprint generate") and ranks > 1:
        return f"OMP_NUM_THREADS=1 mpirun --oversubscribe -n {ranks} {command}"
    if command.startswith(("softprint train", "softprint run", "softprint report")):
        return f"OMP_NUM_THREADS={os.cpu_count()} {command}"
    return command


def _version(root: Path) -> str:
    """The commit, with + if files differ from it."""
    described = subprocess.run(
        ["git", "describe", "--always", "--dirty=+"], cwd=root, capture_output=True, text=True, check=False
    )
    return described.stdout.strip() or "unknown"


def main(words: Sequence[str] | None = None, records: Records | None = None) -> int:
    """Make what is asked for; 1 if a command failed."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("names", nargs="*", metavar="NAME", help="figures to make (default: all)")
    parser.add_argument("--list", action="store_true", help="say what there is, and what of it is made")
    parser.add_argument("--again", action="store_true", help="make them anew, but not what they need")
    parser.add_argument("--ranks", type=int, default=2, help="of `softprint generate` (default: 2)")
    options = parser.parse_args(words)
    records = records or Records(REPOSITORY)
    unknown = [name for name in options.names if name not in records.figures]
    if unknown:
        parser.error(f"no figure {unknown[0]!r}; there are {', '.join(records.figures)}")
    asked = options.names or list(records.figures)
    if options.list:
        for name in asked:
            figure = records.figures[name]
            print(f"{name}: {records.state(name)}; {', '.join(figure.pages)}")
            print(*(f"    {command}" for command in figure.commands), sep="\n")
        return 0
    failed: set[str] = set()
    for name in records.with_needs(asked):
        if failed & set(records.figures[name].needs):
            failed.add(name)
            print(f"{name}: left out, for what it needs was not made", file=sys.stderr)
        elif records.state(name) == "made" and not (options.again and name in asked):
            print(f"{name}: made, see {records.path(name)}")
        elif not records.make(name, options.ranks):
            failed.add(name)
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
