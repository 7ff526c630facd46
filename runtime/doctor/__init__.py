"""Checks of the installation, one for each known problem."""

from softprint.runtime.doctor.examine import examine
from softprint.runtime.doctor.finding import Finding, Level

__all__ = ["Finding", "Level", "examine"]
