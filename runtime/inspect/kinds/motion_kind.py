"""A motion file: one scene played by one model."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from softprint.runtime.drawing.scene import Scene
from softprint.runtime.errors import SoftprintError
from softprint.runtime.inspect.file_head import FileHead
from softprint.runtime.inspect.kind import Kind, Part
from softprint.runtime.inspect.picture import known_colliders, placed_surfaces
from softprint.runtime.inspect.summary import Section, Summary, spread, versions
from softprint.runtime.io.files import open_softprint_h5, read_text
from softprint.runtime.scenes.motion_file import KIND as MOTION
from softprint.runtime.scenes.motion_file import VERSION, Motion, load_motion


def recognise(head: FileHead) -> bool:
    return head.h5 is not None and head.kind == MOTION


def summarise(path: Path, part: Part) -> Summary:
    """Reads everything except the positions, of which only the requested frame is read."""
    motion = load_motion(path)
    with open_softprint_h5(path, MOTION, VERSION) as file:
        provenance, experiment = json.loads(file.attrs["provenance"]), read_text(file.attrs, "experiment")
        nodes, dim = (int(size) for size in file["positions"].shape[1:])
    sections: dict[str, Section] = {
        "motion": {
            "scene, model": [motion.scene, motion.model],
            "frames": motion.n_frames,
            "time [s]": [float(motion.times[0]), float(motion.times[-1])],
            "nodes, dimension": [nodes, dim],
            "frames in contact": int(motion.in_contact.sum()),
        },
        "quality": {
            "converged share": float(motion.converged.mean()),
            "by status": {
                name: int((motion.status == code).sum())
                for code, name in motion.status_names.items()
                if (motion.status == code).any()
            },
            "Newton iterations": spread(motion.iterations),
            "relative residual": spread(motion.residual),
            "penetration [m]": spread(motion.penetration),
            "smallest det F": float(motion.min_det_F.min()),
            "seconds a step": spread(motion.timings["total"]) if "total" in motion.timings else None,
        },
        "deepest inside the body [m]": {
            name: float(track.intrusion.max())
            for name, track in motion.colliders.items()
            if not np.isnan(track.intrusion).any()
        },
        "largest forces [N]": {
            name: float(np.linalg.norm(track.force, axis=1).max()) for name, track in motion.colliders.items()
        },
    }
    if part.frame is not None:
        sections[f"frame {part.frame}"] = _frame(motion, part.frame)
    sections |= {
        "hashes": {"body": motion.body_hash, "inputs": motion.inputs_hash},
        "made with": versions(provenance),
    }
    return Summary(path, "a motion", sections, experiment)


def _frame(motion: Motion, frame: int) -> dict[str, Any]:
    if not 0 <= frame < motion.n_frames:
        raise SoftprintError(f"{motion.path}: no frame {frame}; they are numbered 0 to {motion.n_frames - 1}")
    return {
        "time [s]": motion.times[frame],
        "status": motion.status_names.get(int(motion.status[frame]), "unknown"),
        "Newton iterations": motion.iterations[frame],
        "relative residual": motion.residual[frame],
        "penetration [m]": motion.penetration[frame],
        "energies [J]": {name: float(values[frame]) for name, values in motion.energies.items()},
        "forces on colliders [N]": {name: track.force[frame] for name, track in motion.colliders.items()},
    }


def scene(path: Path, part: Part, experiment: Path | None) -> Scene:
    """A frame, coloured by the displacement from rest; by default the frame of deepest penetration. Its colliders are
    those in the file, or those of the experiment if one is given."""
    motion = load_motion(path)
    frame = int(np.argmax(motion.penetration)) if part.frame is None else part.frame
    rest, points = motion.rest, motion.positions(frame)
    poses = {name: track.poses[frame] for name, track in motion.colliders.items()}
    if experiment is None:
        colliders = motion.build_colliders()
    else:
        colliders = known_colliders(poses, experiment)
    return Scene(
        f"{motion.scene} with {motion.model}: frame {frame}, {motion.times[frame]:.3f} s",
        points,
        rest.facets,
        rest.cells if rest.dim == 2 else None,
        values=1e3 * np.linalg.norm(points - rest.points, axis=1),
        label="displacement [mm]",
        solids=placed_surfaces(colliders, poses),
    )


KIND = Kind(recognise, summarise, part="frame", scene=scene)
