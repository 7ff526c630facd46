"""Training data of learned forces, of several colliders: one that touches the reduced body in no sample is left out."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import torch

from softprint.runtime.errors import SoftprintError
from softprint.surrogate.force import data as force_module
from softprint.surrogate.force import entry


class _Joined:
    """Data of the names that are its parts, a sample each."""

    def __init__(self, parts):
        self.parts, self.sample = parts, torch.arange(len(parts))

    def take(self, which):
        return [self.parts[k] for k in which]


@pytest.fixture
def data(monkeypatch):
    for name in ("mechanics", "metric", "internal_below"):
        monkeypatch.setattr(entry, name, lambda *_: None)
    monkeypatch.setattr(entry, "join_force_data", _Joined)
    monkeypatch.setattr(entry, "ForceData", SimpleNamespace(of_arrays=lambda arrays: arrays))
    parts = [("needle", np.array([0, 1])), ("ball", np.array([2]))]
    tables = {"contacts": {"collider": np.array([0, 1])}, "samples": {"contact": np.array([0, 0, 1])}}
    truth = SimpleNamespace(path=Path("truth.h5"), **tables)
    return SimpleNamespace(
        truth=truth, body=None, by_collider=lambda samples: parts, build_colliders=lambda samples: None
    )


def test_it_is_left_out(data, monkeypatch) -> None:
    def read(_truth, _body, collider, *_):
        return None if collider == "needle" else SimpleNamespace(arrays=collider)

    monkeypatch.setattr(entry, "read_force_data", read)
    assert entry.force_data(data, None, None, np.arange(3)) == ["ball"]


def test_with_none_that_touches_there_is_nothing_to_learn_from(data, monkeypatch) -> None:
    monkeypatch.setattr(entry, "read_force_data", lambda *_: None)
    with pytest.raises(SoftprintError, match=r"truth.h5: in none of the 3 requested samples"):
        entry.force_data(data, None, None, np.arange(3))


def test_samples_that_do_not_touch_give_no_data(monkeypatch) -> None:
    probe = SimpleNamespace(contact=SimpleNamespace(loaded=None))
    monkeypatch.setattr(force_module, "ContactStateProbe", lambda *_: probe)
    monkeypatch.setattr(force_module, "touching_samples", lambda *_: iter(()))
    body = SimpleNamespace(node_points=lambda: SimpleNamespace(basis_gradient=None))
    options = SimpleNamespace(law=None, band=0.0, learned=None)
    assert force_module.read_force_data(None, body, None, None, options, None, np.arange(2)) is None
