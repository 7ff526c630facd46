"""Is this machine fit for the work? One check for each thing that has been seen to go wrong."""

from runtime.doctor.examine import examine
from runtime.doctor.finding import Finding, Level

__all__ = ["Finding", "Level", "examine"]
