"""Error measures for comparing models."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class HeldOutError:
    """Errors over a set of samples, relative to the displacement (0: perfect; 1: no better than no correction).

    rms = sqrt(sum w |u_pred - u|^2 / sum w |u|^2) over samples and nodes, w the node volumes; worst: the
    largest rms of a single sample; samples: number of samples.
    """

    rms: float
    worst: float
    samples: int

    @property
    def squared(self) -> float:
        """Mean squared error relative to the mean squared displacement: rms^2."""
        return self.rms**2
