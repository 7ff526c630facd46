"""All points at which a body may touch colliders: those on its facets, and those that sharp points press."""

from __future__ import annotations

from dataclasses import dataclass, field

from softprint.runtime.arrays import Array
from softprint.runtime.contact.solver.contact_points import ContactPoints, CorotatedPoints
from softprint.runtime.contact.solver.pressed_points import CorotatedPressedPoints, PressedPoints
from softprint.runtime.mechanics.compliance.interpolated_compliance import InterpolatedCompliance
from softprint.runtime.mechanics.loaded_points import LoadedPoints


@dataclass(frozen=True, eq=False)
class AllPoints:
    """All contact points while some are pressed by sharp points of colliders. stiffness: a k (n,) [N/m^2]; points:
    those pressed alone."""

    pressed: PressedPoints | None
    loaded: LoadedPoints
    compliance: InterpolatedCompliance
    stiffness: Array
    points: ContactPoints | None
    _last: list[tuple[CorotatedPoints, CorotatedPoints]] = field(default_factory=list, repr=False)

    def in_frame(self, of_facets: CorotatedPoints) -> CorotatedPoints:
        """In the frame of the points on the facets. The last are kept; this affects the cost and never the result."""
        if self.points is None or self.pressed is None:
            return of_facets
        last = self._last[0] if self._last else None  # read once, as another thread may replace it
        if last is None or last[0] is not of_facets:
            last = of_facets, CorotatedPressedPoints.of(of_facets, self.points, self.pressed.index)
            self._last[:] = [last]
        return last[1]
