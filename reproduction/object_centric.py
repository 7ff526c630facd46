"""The object-centric method of the thesis's chapter 4 beside the models of a run: tables 4.2 and 5.2.

    softprint run examples/jelly2d_circle_small.toml
    python -m reproduction.object_centric examples/jelly2d_circle_small.toml --components 50 --widths 100

Needs the truth and the motions of the run. The method is trained on the usable samples of the truth: principal
components of r = F^-1 (x - U q), with F the deformation gradient of the subspace at the nodes, as functions of the
collider's place and rotation relative to the handles; two tanh layers, Adam, batches of 512 (eqs. 4.7 to 4.9, 4.3.3).
Like the Jelly of table 4.1, it has no internal correction: r is the whole of it. A table in Markdown, for each model:

    samples       on the samples of the held-out states, sqrt(sum |x(model) - x|^2 / sum |U q - x|^2)
    held-out      the same over the nodes and the frames in contact of the test scenes, at the full-space motion's state

The other models are the corrections of the run, with their internal displacement. --samples: learn from so many.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch

from softprint.fem_truth.report.measurements.held_out import Comparer, HeldOutMotion
from softprint.fem_truth.report.run_files import FULL, RunFiles, find_run_files, judged_scenes, load_motions
from softprint.runtime.arrays import Array, IntArray
from softprint.runtime.body import ReducedBody
from softprint.runtime.body.rotations import nearest_rotation
from softprint.runtime.cli.context import Context
from softprint.runtime.cli.run_body import body_of_run
from softprint.runtime.colliders.build import build_collider
from softprint.runtime.colliders.pose import RigidPose
from softprint.runtime.contact.intrusion import pierced_from
from softprint.runtime.errors import SoftprintError
from softprint.runtime.experiment import Experiment
from softprint.runtime.learned.correction_file import load_correction
from softprint.runtime.learned.static_correction import StaticCorrection
from softprint.runtime.truth.truth_file import TruthData, load_truth

BATCH, LEARNING_RATE = 512, 1e-3
OBJECT_CENTRIC = "object-centric"
Target = Callable[[TruthData, int], Array]


@dataclass(frozen=True, eq=False)
class Interaction:
    """What the network reads: the collider relative to the handles, A(q)^-1 z."""

    body: ReducedBody

    def __call__(self, rows: Array, pose: RigidPose) -> Array:
        """Its place relative to every handle [m], in the axes of the handle if it is a frame and of the first frame
        otherwise, and its rotation relative to the first frame; without frames in the axes of the world."""
        handles, dim = self.body.handles, self.body.dim
        turns = [nearest_rotation(rows[handles.rows_of(frame.name)][:dim].T) for frame in handles.frames]
        first = turns[0] if turns else np.eye(dim)
        places = [(pose.translation - rows[: handles.n_points]) @ first]
        for frame, turn in zip(handles.frames, turns, strict=True):
            places.append(((pose.translation - handles.position(rows, frame.name)) @ turn)[None])
        return np.concatenate([np.vstack(places).ravel(), (first.T @ pose.rotation).ravel()])


@dataclass(frozen=True, eq=False)
class ObjectCentric:
    """x = U q + F sum_k c_k(A(q)^-1 z) m_k. modes: (components, n_nodes, dim)."""

    body: ReducedBody
    network: torch.nn.Module
    modes: Array
    mean: Array
    spread: Array
    scale: float

    def displacement(self, rows: Array, pose: RigidPose) -> Array:
        """x - U q (n_nodes, dim) [m]."""
        read = (Interaction(self.body)(rows, pose) - self.mean) / self.spread
        with torch.no_grad():
            c = self.network(torch.from_numpy(read).float()).double().numpy() * self.scale
        r = np.einsum("k,knd->nd", c, self.modes)
        return np.asarray(np.einsum("ndj,nj->nd", gradients(self.body, rows), r))


def gradients(body: ReducedBody, rows: Array) -> Array:
    """F (n_nodes, dim, dim) of the subspace at the nodes."""
    return np.einsum("rd,nrj->ndj", rows, body.node_points().basis_gradient)


def whole(truth: TruthData, sample: int) -> Array:
    """x - U q (n_nodes, dim) [m] of a sample."""
    return contact_alone(truth, sample) + truth.internal(int(truth.sample_state[sample]))


def contact_alone(truth: TruthData, sample: int) -> Array:
    """What contact alone adds (n_nodes, dim) [m] in a sample: the target of an external correction, eq. 4.9."""
    return truth.displacement(sample).astype(float)


def trained(
    truth: TruthData,
    body: ReducedBody,
    samples: IntArray,
    widths: Sequence[int],
    components: int,
    steps: int,
    target: Target = whole,
) -> ObjectCentric:
    """Learned from samples of a truth; sums are weighted by the volumes of the nodes."""
    read, fields = [], []
    for sample in map(int, samples):
        rows = truth.states["rows"][truth.sample_state[sample]]
        read.append(Interaction(body)(rows, truth.pose(sample)))
        r = np.linalg.solve(gradients(body, rows), target(truth, sample)[..., None])[..., 0]
        fields.append(r.astype(np.float32))
    weight = np.sqrt(body.mesh.node_volumes)[:, None]
    data = (np.array(fields) * weight).reshape(len(fields), -1)
    _, s, vt = np.linalg.svd(data, full_matrices=False)
    count = min(components, len(s))
    modes = (vt[:count].reshape(count, *weight.shape[:1], -1) / weight).astype(float)
    print(
        f"{len(samples)} samples; {count} components leave {np.sqrt(1 - (s[:count] ** 2).sum() / (s**2).sum()):.1%}"
    )
    inputs, coefficients = np.array(read), torch.from_numpy(data @ vt[:count].T).float()
    mean, spread = inputs.mean(axis=0), np.maximum(inputs.std(axis=0), 1e-6)
    scale = float(coefficients.square().mean().sqrt())
    z, goal = torch.from_numpy((inputs - mean) / spread).float(), coefficients / scale
    torch.manual_seed(0)
    layers: list[torch.nn.Module] = []
    for before, after in zip([z.shape[1], *widths[:-1]], widths, strict=True):
        layers += [torch.nn.Linear(before, after), torch.nn.Tanh()]
    network = torch.nn.Sequential(*layers, torch.nn.Linear(widths[-1], count))
    optimiser = torch.optim.Adam(network.parameters(), lr=LEARNING_RATE)
    for _ in range(steps):
        index = torch.randint(len(z), (min(BATCH, len(z)),))
        optimiser.zero_grad()
        loss = (network(z[index]) - goal[index]).square().mean()
        loss.backward()
        optimiser.step()
    with torch.no_grad():
        left = (network(z) - goal).square().sum() / goal.square().sum()
    print(f"training error {float(left.sqrt()):.1%} of the components")
    return ObjectCentric(body, network.eval(), modes, mean, spread, scale)


def on_samples(truth: TruthData, model: ObjectCentric, samples: IntArray, target: Target = whole) -> float:
    """The first column."""
    missed = size = 0.0
    for sample in map(int, samples):
        rows, exact = truth.states["rows"][truth.sample_state[sample]], target(truth, sample)
        missed += np.square(model.displacement(rows, truth.pose(sample)) - exact).sum()
        size += np.square(exact).sum()
    return float(np.sqrt(missed / size)) if size else float("nan")


def on_motions(
    experiment: Experiment, files: RunFiles, body: ReducedBody, model: ObjectCentric
) -> dict[str, dict[str, float]]:
    """The second column: by scene and model."""
    found = {}
    for scene in judged_scenes(experiment):
        full = load_motions(files, experiment, scene, body)[FULL]
        collider = build_collider(experiment.collider(scene.colliders[0].name), experiment.base_dir)
        motion = HeldOutMotion(
            full.times, full.colliders[collider.name].poses, full.in_contact, full.positions
        )
        corrections = {
            name: StaticCorrection(load_correction(path, body, collider), body)
            for name, path in files.corrections.items()
        }
        comparer = Comparer(body, collider, motion, corrections)
        contact, _ = comparer.contact_frames()
        contact = contact[~full.invalid(pierced_from(body.mesh))[contact]]
        comparer.begin()
        missed = dict.fromkeys(["bare", *corrections, OBJECT_CENTRIC], 0.0)
        for frame in map(int, contact):
            positions, rows = comparer.positions(frame), comparer.rows(frame)
            own = model.displacement(rows, motion.poses[frame])
            positions[OBJECT_CENTRIC] = positions["bare"] + own
            for name in missed:
                missed[name] += np.square(positions[name] - positions[FULL]).sum()
        found[scene.name] = {name: float(np.sqrt(value / missed["bare"])) for name, value in missed.items()}
    return found


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("experiment", type=Path)
    parser.add_argument("--out", type=Path, help="run directory (default: runs/NAME)")
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE", help="as of the run")
    parser.add_argument(
        "--widths", type=int, nargs="+", default=[250, 250], help="neurons (default: 250 250)"
    )
    parser.add_argument("--components", type=int, default=100, help="principal ones (default: 100)")
    parser.add_argument("--steps", type=int, default=4000, help="of the optimiser (default: 4000)")
    parser.add_argument("--samples", type=int, help="to learn from (default: all)")
    given = parser.parse_args()
    context = Context(experiment_path=given.experiment, overrides=tuple(given.set), out=given.out, quiet=True)
    experiment = context.experiment
    try:
        files, body = find_run_files(context.out_dir, experiment), body_of_run(context)
        if files.truth is None:
            raise SoftprintError(f"{context.out_dir}: has no truth.h5: softprint generate {given.experiment}")
        with load_truth(files.truth, body) as truth:
            last = truth.sample_state >= len(truth.states) - experiment.training.validation_states
            learned = np.random.default_rng(0).permutation(np.flatnonzero(truth.usable & ~last))
            held = np.flatnonzero(truth.usable & last)
            learned = learned[: given.samples]
            model = trained(truth, body, learned, given.widths, given.components, given.steps)
            samples = on_samples(truth, model, held)
        motions = on_motions(experiment, files, body, model)
    except SoftprintError as error:
        parser.error(str(error))
    print("\n| model | samples | " + " | ".join(motions) + " |\n" + "| --- " * (2 + len(motions)) + "|")
    for name in next(iter(motions.values())):
        first = f"{samples:.1%}" if name == OBJECT_CENTRIC else ""
        print(f"| {name} | {first} | " + " | ".join(f"{own[name]:.1%}" for own in motions.values()) + " |")


if __name__ == "__main__":
    main()
