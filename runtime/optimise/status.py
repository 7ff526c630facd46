"""How a minimisation ended, with advice."""

from __future__ import annotations

from enum import IntEnum


class Status(IntEnum):
    """How a minimisation ended. The numbers go into truth and motion files: never renumber.

    (In truth files 5 is a sample that was never started, `runtime.truth.truth_schema.UNREACHED`: full-space solves
    never end as STALLED. PIERCED and those after it are of reduced steps, which may converge nevertheless.)
    """

    CONVERGED = 0
    MAX_ITERATIONS = 1
    LINE_SEARCH_FAILED = 2
    UNSTABLE = 3
    NOT_FINITE = 4
    STALLED = 5
    PIERCED = 6
    CONTACT_UNSOLVED = 7
    CORRECTION_UNSOLVED = 8
    HARDENING_HELD = 9

    @property
    def sentence(self) -> str:
        """What happened and what to do about it."""
        return _SENTENCES[self]


_SENTENCES = {
    Status.CONVERGED: "Forces balance, and every tolerance is met.",
    Status.MAX_ITERATIONS: "The iterations ran out before the residual was found to meet the tolerances: acceptable in "
    "real time; otherwise allow more iterations, or start nearer (a smaller time step, a deep contact approached in "
    "smaller steps).",
    Status.LINE_SEARCH_FAILED: "No step along the search direction lowers the energy: the tolerances may be below "
    "round-off (or below what the float32 network of a correction resolves), or the start has inverted cells.",
    Status.UNSTABLE: "Forces balance, but the energy has negative curvature there: a saddle, from which the "
    "body would snap away.",
    Status.NOT_FINITE: "The energy or a derivative of it is not finite: inverted cells in a material that resists "
    "inversion with infinite energy, or positions that are not numbers; take a smaller time step or start nearer.",
    Status.STALLED: "The energy hardly decreases further, but forces balance only approximately: the energy is "
    "discontinuous close by, as where a contact node slips from one side of a thin wall to the other; take a smaller "
    "time step.",
    Status.PIERCED: "A collider has pierced the body, or would have: it is pressed or thrown harder than the body can "
    "give way, or it is thinner than the distance between surface nodes. Press less deep, or use a stiffer body, a "
    "finer mesh or more contact nodes.",
    Status.CONTACT_UNSOLVED: "Handles balance, but with contact forces that do not: the contact solve within the step "
    "did not converge, as where a contact point may go to either side of a thin wall; take a smaller time step.",
    Status.CORRECTION_UNSOLVED: "Handles balance, but the modes of the internal correction do not: their amplitudes of "
    "least elastic energy were not found, as where cells are inverted; take a smaller time step, or give the "
    "correction more cells of cubature.",
    Status.HARDENING_HELD: "Forces balance, with the hardening of contact held as it was at the start of the step: the "
    "learned energy has no minimum close by, as where a contact point is about to slide around a thin rod.",
}
