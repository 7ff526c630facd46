"""`softprint import`: convert a data set published with the thesis's papers to body, truth and experiment."""

from __future__ import annotations

import argparse
import shlex
from pathlib import Path

from softprint.runtime.cli.context import Context, run_directory
from softprint.runtime.cli.verb import Verb


def configure(parser: argparse.ArgumentParser) -> None:
    """The two files, and the values that they do not contain."""
    parser.add_argument("dataset", type=Path, metavar="DATASET.h5", help="q, z, x")
    parser.add_argument("meshes", type=Path, metavar="MESHES.h5", help="W, q_ref, tris, tets; W, z_ref, tris")
    parser.add_argument("--out", type=run_directory, required=True, metavar="DIR", help="run directory to create")
    parser.add_argument("--young", type=float, required=True, metavar="PA", help="Young's modulus [Pa]")
    parser.add_argument("--poisson", type=float, required=True, metavar="NU", help="Poisson's ratio")
    parser.add_argument(
        "--density", type=float, default=1000.0, metavar="KG", help="[kg/m^3], in the plane [kg/m^2]"
    )
    parser.add_argument(
        "--material", default="stable_neo_hookean", metavar="MODEL", help="energy of the material"
    )
    parser.add_argument(
        "--scale", type=float, default=1.0, metavar="M", help="metres for each unit of the files"
    )


def run(args: argparse.Namespace, context: Context) -> int:
    """Write body.h5, truth.h5, experiment.toml and the files that it names."""
    import math

    from softprint.runtime.body import save_body
    from softprint.runtime.colliders.build import build_collider
    from softprint.runtime.elasticity.materials import make_material
    from softprint.runtime.errors import SoftprintError
    from softprint.runtime.experiment import load_experiment
    from softprint.runtime.io.files import content_hash
    from softprint.runtime.published.adopt import adopt_body, adopted_poses, write_adopted_truth
    from softprint.runtime.published.adopted_files import GivenMaterial, frames_without_box, write_experiment
    from softprint.runtime.published.layout import open_dataset, read_meshes

    if not (math.isfinite(args.scale) and args.scale > 0):
        raise SoftprintError(f"--scale {args.scale}: must be a positive number of metres")
    if (args.out / "truth.h5").exists():
        raise SoftprintError(f"{args.out / 'truth.h5'} exists already: choose another --out")
    meshes = read_meshes(args.meshes)
    material = make_material(args.material, args.young, args.poisson)
    given = GivenMaterial(args.material, args.young, args.poisson, args.density)
    with open_dataset(args.dataset, meshes) as data:
        with context.stage("building the body"):
            adopted = adopt_body(meshes.body, material, args.density, args.scale, str(args.meshes))
        poses = adopted_poses(meshes.collider, data.z, args.scale, str(args.dataset))
        path = write_experiment(args.out, adopted.body, meshes.collider, given, args.scale, str(args.meshes))
        experiment = load_experiment(path)
        collider = build_collider(experiment.colliders[0], experiment.base_dir)
        save_body(args.out / "body.h5", adopted.body)
        made_from = {
            "published q and z": content_hash({"q": data.q, "z": data.z}),
            "body hash": adopted.body.content_hash,
            "scale": repr(args.scale),
        }
        with context.progress(len(data), "samples", "import") as bar:
            groups = write_adopted_truth(
                *(
                    args.out / "truth.h5",
                    adopted,
                    collider,
                    data,
                    poses,
                    args.scale,
                    experiment.text,
                    made_from,
                ),
                bar.update,
            )
    context.say(
        f"{args.out}: body.h5 and truth.h5, {len(groups.state)} samples of {len(groups.first_of_contact)} contacts "
        f"in {len(groups.first_of_state)} states\n"
        "Not in such a data set: material and density (as given), contact stiffness, gravity, scenes, and the accuracy "
        "of the samples.\nInternal deformation is part of the contact displacement."
    )
    lost = frames_without_box(adopted.body)
    if lost:
        context.say(f"No box describes the frame {', '.join(lost)}, so {path} cannot be used for training.")
    else:
        context.say(f"Train with: softprint train {shlex.quote(str(path))} --out {shlex.quote(str(args.out))}")
    return 0


VERB = Verb(
    name="import",
    order=47,
    summary="Make body, truth and experiment from a data set published with the thesis's papers.",
    example="softprint import dataset.h5 meshes.h5 --out runs/published --young 2e4 --poisson 0.4",
    run=run,
    needs=("h5py", "igl"),
    configure=configure,
    reads_experiment=False,
)
