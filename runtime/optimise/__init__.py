"""Minimisation of energies: what a problem is, what an optimiser is, how it may end, and Newton's method.

To step with another optimiser, write a class with the methods of `Optimiser` (`optimiser.py`) and give it to
`DynamicsSettings(optimiser=...)`; what it minimises is `runtime/dynamics/step/step_energy.py`.
"""

from softprint.runtime.optimise.newton import Newton
from softprint.runtime.optimise.optimiser import Linearisation, Minimum, Optimiser, Problem
from softprint.runtime.optimise.settings import NewtonSettings
from softprint.runtime.optimise.status import Status

__all__ = ["Linearisation", "Minimum", "Newton", "NewtonSettings", "Optimiser", "Problem", "Status"]
