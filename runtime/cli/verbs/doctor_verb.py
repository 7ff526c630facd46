"""`softprint doctor`: check the installation."""

from __future__ import annotations

import argparse

from softprint.runtime.cli.context import Context
from softprint.runtime.cli.verb import Verb


def run(options: argparse.Namespace, context: Context) -> int:
    """Print one line for each check; 1 if something needed does not work."""
    from softprint.runtime.doctor import Level, examine

    if context.rank > 0:
        return 0
    fatal = 0
    for finding in examine():
        context.say(f"{finding.level.value:<8} {finding.subject:<20} {finding.detail}")
        if finding.level is not Level.OK and finding.remedy:
            context.say(f"{'':<8} {'':<20} -> {finding.remedy}")
        fatal += finding.is_fatal
    if fatal:
        context.say(f"\n{fatal} of these must be fixed first.")
        return 1
    context.say("\nEverything required works.")
    return 0


VERB = Verb(
    name="doctor",
    order=0,
    summary="Check versions, BLAS, MPI, HDF5 and graphics, with a remedy for each problem.",
    example="softprint doctor",
    run=run,
    reads_experiment=False,
)
