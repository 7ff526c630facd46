"""Condensed contact: the energy of a solved contact, its gradient, Hessian, forces, sensitivities and friction.

`condensed_contact.py` finds and solves the contact (with `runtime/contact/solver/`); its gradient and the contact
Hessian of a reduced step are in `runtime/contact/linearised/`, and in `runtime/contact/learned_energy/` under a learned
energy; `contact_evaluation.py` hands both to the step.
"""
