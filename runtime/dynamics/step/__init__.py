"""One step: its corotated frame, the body evaluated at a state, the energy, where it starts, its minimisation.

Energy, gradient and Hessian of a step are summed in `step_energy.py`, which says where each part comes from.
"""
