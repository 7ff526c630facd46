"""A truth file: number, accuracy and label noise of its samples."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from softprint.runtime.drawing.scene import Scene
from softprint.runtime.errors import SoftprintError
from softprint.runtime.inspect.file_head import FileHead
from softprint.runtime.inspect.kind import Kind, Part
from softprint.runtime.inspect.picture import known_colliders, placed_surfaces
from softprint.runtime.inspect.summary import Section, Summary, byte_size, spread, versions
from softprint.runtime.io.files import open_softprint_h5
from softprint.runtime.mesh import Mesh
from softprint.runtime.truth.truth_file import TruthData, load_truth
from softprint.runtime.truth.truth_schema import CONVERGED, SAMPLES, STATUS_NAMES, VERSION
from softprint.runtime.truth.truth_schema import KIND as TRUTH


def recognise(head: FileHead) -> bool:
    return head.h5 is not None and head.kind == TRUTH


def summarise(path: Path, part: Part) -> Summary:
    """Reads every column except the displacements."""
    with load_truth(path) as truth:
        sections: dict[str, Section] = {
            "truth": _contents(truth),
            "quality of converged samples": _quality(truth),
        }
        if part.sample is not None:
            sections[f"sample {part.sample}"] = _sample(truth, part.sample)
        sections |= {
            "hashes": {"content": truth.content_hash, "body": truth.header.body_hash},
            "made with": {"seed": str(truth.header.seed), **versions(truth.provenance)},
        }
        return Summary(path, "ground truth", sections, truth.header.experiment)


def _contents(truth: TruthData) -> dict[str, Any]:
    status = truth.samples["status"]
    fields = 4 * truth.n_samples * truth.n_nodes * truth.dim
    return {
        "samples": truth.n_samples,
        "by status": {
            name: int((status == code).sum()) for code, name in STATUS_NAMES.items() if (status == code).any()
        },
        "jumped to another branch": int(truth.samples["branch_flag"].sum()),
        "pierced by the collider": int(truth.pierced.sum()),
        "with inverted cells": int(truth.inverted.sum()),
        "usable for training": int(truth.usable.sum()),
        "contacts, planned": [len(truth.contacts), truth.header.planned_contacts],
        "states, refused": [len(truth.states), len(truth.refused)],
        "colliders": list(truth.header.colliders),
        "solved twice": len(truth.repeat),
        "label-noise floor": truth.noise_floor,
        "nodes, dimension": [truth.n_nodes, truth.dim],
        "displacements in memory": byte_size(fields),
        "core-seconds": float(truth.contacts["seconds"].sum() + truth.states["seconds"].sum()),
    }


def _quality(truth: TruthData) -> dict[str, Any]:
    samples = truth.samples
    good = samples["status"] == CONVERGED
    det_F = samples["min_det_F"][good]
    return {
        "depth [m]": spread(samples["depth"][good]),
        "relative residual": spread(samples["residual"][good]),
        "relative Newton decrement": spread(samples["decrement"][good]),
        "Newton iterations": spread(samples["newton_iterations"][good]),
        "CG iterations": spread(samples["cg_iterations"][good]),
        "smallest det F": {"smallest": float(det_F.min()), "median": float(np.median(det_F))}
        if good.any()
        else None,
        "penetration left [m]": spread(samples["max_depth"][good]),
        "collider inside the body [m]": spread(samples["intrusion"][good]),
        "core-seconds a sample": spread(samples["seconds"][good]),
    }


def _sample(truth: TruthData, sample: int) -> dict[str, Any]:
    if not 0 <= sample < truth.n_samples:
        raise SoftprintError(
            f"{truth.path}: no sample {sample}; they are numbered 0 to {truth.n_samples - 1}"
        )
    columns = [
        key for key, column in SAMPLES.items() if not column.shape and key not in ("status", "contact")
    ]
    size = np.linalg.norm(truth.displacement(sample), axis=1)
    contact = int(truth.samples["contact"][sample])
    return {
        "state, contact": [int(truth.sample_state[sample]), contact],
        "place (node)": int(truth.contacts["place"][contact]),
        "status": _status(truth, sample),
        "usable for training": bool(truth.usable[sample]),
        **{_with_unit(key): truth.samples[key][sample] for key in columns},
        "displacement [m]": {"largest": float(size.max()), "RMS": float(np.sqrt(np.mean(size**2)))},
    }


def _status(truth: TruthData, sample: int) -> str:
    code = int(truth.samples["status"][sample])
    return STATUS_NAMES.get(code, f"unknown code {code}")


def _collider(truth: TruthData, sample: int) -> str:
    number = int(truth.contacts["collider"][truth.samples["contact"][sample]])
    if not 0 <= number < len(truth.header.colliders):
        raise SoftprintError(
            f"{truth.path}: sample {sample} is of collider {number}, which has no name: make it again"
        )
    return truth.header.colliders[number]


def _with_unit(key: str) -> str:
    unit = SAMPLES[key].unit
    return f"{key} [{unit}]" if unit not in ("", "1") else key


def scene(path: Path, part: Part, experiment: Path | None) -> Scene:
    """The deformed body of a sample, coloured by the contact displacement; the deepest sample by default."""
    with load_truth(path) as truth:
        converged = truth.samples["status"] == CONVERGED
        sample = part.sample
        if sample is None:
            sample = int(np.argmax(np.where(converged, truth.samples["depth"], -np.inf)))
        if not converged[sample]:
            raise SoftprintError(
                f"{path}: sample {sample} has no solution to draw ({_status(truth, sample)})"
            )
        displacement, state = truth.displacement(sample), int(truth.sample_state[sample])
        collider = _collider(truth, sample)
        depth, pose = float(truth.samples["depth"][sample]), truth.pose(sample)
    with open_softprint_h5(path, TRUTH, VERSION) as file:
        cells, equilibrium = file["mesh/cells"][()], file[f"view/points_{state}"][()]
    points = equilibrium + displacement
    mesh = Mesh(points, cells)
    return Scene(
        f"sample {sample}: state {state}, {collider}, {1e3 * depth:.2f} mm deep",
        points,
        mesh.facets,
        cells if mesh.dim == 2 else None,
        values=1e3 * np.linalg.norm(displacement, axis=1),
        label="contact displacement [mm]",
        solids=placed_surfaces(known_colliders([collider], experiment), {collider: pose})
        if experiment
        else [],
    )


KIND = Kind(recognise, summarise, part="sample", scene=scene)
