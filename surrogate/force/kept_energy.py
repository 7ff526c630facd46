"""The learned energy of contact in the run directory: learning it takes minutes, and a training that was stopped, or
that of another network on the same truth and mechanics, finds it there."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from softprint.runtime.contact.learned_energy.learned_energy import LearnedEnergy
from softprint.runtime.experiment.schema.training import ModelSpec
from softprint.runtime.io.files import content_hash
from softprint.runtime.io.kept_json import keep, read_kept
from softprint.runtime.learned.force.model import ForceModelOptions
from softprint.runtime.scenes.scene import held_frames
from softprint.surrogate.data.training_data import TrainingData
from softprint.surrogate.force.energy import EnergyErrors
from softprint.surrogate.kept_corrections import internal_recipe, program_hash

# None where the truth has no forces.
Learned = tuple[LearnedEnergy | None, EnergyErrors] | None


def energy_path(run: Path, contact_nodes: int) -> Path:
    """In a run directory, of the mechanics with at most so many contact nodes."""
    return run / f"energy_{contact_nodes}.json"


def kept_energy(
    data: TrainingData, spec: ModelSpec, options: ForceModelOptions, learn: Callable[[], Learned]
) -> Learned:
    """That of an earlier training with the same truth, samples, mechanics, contact law and program; or a new one, which
    is kept. With --no-resume it is learned anew."""
    path, made_of = energy_path(data.context.out_dir, spec.contact_nodes), _made_of(data, spec, options)
    if data.context.resume and (kept := read_kept(path, made_of)) is not None:
        try:
            energy = None if kept["energy"] is None else LearnedEnergy.of(tuple(kept["energy"]))
            errors = EnergyErrors(**kept["errors"])
        except (TypeError, KeyError, ValueError):
            pass  # damaged: it is learned again
        else:
            data.context.say(f"energy of contact: kept from an earlier training ({path})")
            return energy, errors
    found = learn()
    if found is not None:
        energy, errors = found
        content = {"energy": None if energy is None else energy.values, "errors": errors._asdict()}
        keep(path, made_of, content)
    return found


def _made_of(data: TrainingData, spec: ModelSpec, options: ForceModelOptions) -> dict[str, Any]:
    """All that the energy depends on, as plain values."""
    law, experiment = options.law, data.context.experiment
    return {
        "truth": data.truth.content_hash,
        "samples": content_hash({"whole": data.split.whole}),
        "seed": data.context.seed,
        "mechanics": data.mechanics.get(spec.contact_nodes)[0].content_hash,
        "static_condensation": spec.static_condensation,
        "held_frames": sorted(held_frames(experiment)),
        **internal_recipe(spec, data.context.out_dir),
        "contact": [law.stiffness, law.refinement, law.reduced_refinement, options.band],
        "program": program_hash(),
    }
