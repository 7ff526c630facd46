"""Forces against full space with the most points on facets: over the frames in which that is in contact."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from benchmarks.contact_quadrature import force_errors
from softprint.runtime.errors import SoftprintError


def motion(forces, scene="press", names=("ball",)):
    """What is read of a motion of colliders that all meet these forces (n, 3) [N]."""
    force = np.asarray(forces, dtype=np.float64)
    tracks = {name: SimpleNamespace(force=force) for name in names}
    touched = np.linalg.norm(force, axis=1) > 0.0
    return SimpleNamespace(
        path=Path("full.h5"), scene=scene, n_frames=len(force), colliders=tracks, in_contact=touched
    )


def test_errors_are_over_the_force_and_the_frames_of_the_reference():
    reference = motion([[0, 0, 0], [0, 0, 3], [0, 0, 4]])
    early = motion([[0, 0, 9], [0, 0, 3], [0, 0, 4]])  # beside the frames that count
    stiff = motion([[0, 0, 0], [0, 0, 3.3], [0, 0.4, 4]])
    errors = force_errors([early, stiff, reference], reference)
    np.testing.assert_allclose(errors, [0.0, np.sqrt((0.09 + 0.16) / 25.0), 0.0], atol=1e-15)


def test_what_cannot_be_compared_is_refused():
    reference = motion([[0, 0, 1.0], [0, 0, 2.0]])
    with pytest.raises(SoftprintError, match="not motions of one scene and length"):
        force_errors([motion([[0, 0, 1.0], [0, 0, 2.0]], scene="push")], reference)
    with pytest.raises(SoftprintError, match="not motions of one scene and length"):
        force_errors([motion([[0, 0, 1.0]])], reference)
    with pytest.raises(SoftprintError, match="nothing is touched"):
        force_errors([reference], motion(np.zeros((2, 3))))
    with pytest.raises(SoftprintError, match="several colliders"):
        force_errors([reference], motion(np.ones((2, 3)), names=("ball", "egg")))
