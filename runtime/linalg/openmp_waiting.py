"""How threads of OpenMP wait for each other: briefly, then asleep.

GNU OpenMP, which PyTorch uses, lets them spin for milliseconds. Where other processes want the same cores, each of the
hundreds of small operations in a step of training then waits until the scheduler has passed over a spinning thread: two
threads beside three busy processes on two cores train at 2 to 6 steps/s of a small network, at 50 to 75 where they spin
for microseconds, and at 250 in place of 220 with the cores to themselves.
"""

from __future__ import annotations

import os

_SPINS = "1000"


def wait_briefly() -> None:
    """For libraries that are loaded later, unless the environment says how threads wait."""
    if "OMP_WAIT_POLICY" not in os.environ:
        os.environ.setdefault("GOMP_SPINCOUNT", _SPINS)
