"""Condensed contact: the energy of a solved contact, its gradient, Hessian, forces, sensitivities and friction.

`condensed_contact.py` finds and solves the contact (with `runtime/contact/solver/`); `linearised_contact.py` has its
gradient and the contact Hessian of a reduced step; `contact_evaluation.py` hands both to the step.
"""
