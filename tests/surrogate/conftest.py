"""Fixtures of internal corrections: a bar, its static condensation and a truth of its internal equilibria."""

from __future__ import annotations

from pathlib import Path

import pytest


@pytest.fixture(scope="module")
def body():
    """A bar of triangles between two frames."""
    from tests.internal_truth import made_bar

    return made_bar()


@pytest.fixture(scope="module")
def condensation(body):
    from softprint.runtime.mechanics.body_mechanics import compute_mechanics

    found = compute_mechanics(body, 20, True).condensation
    assert found is not None
    return found


@pytest.fixture(scope="module")
def truth_path(body, tmp_path_factory) -> Path:
    """Internal equilibria of a bar that is stretched, and of disturbed states."""
    from tests.internal_truth import written_truth

    return written_truth(body, tmp_path_factory.mktemp("truth") / "truth.h5", (0.0, 0.0))
