"""The `[contact]` and `[dynamics]` tables: the energies and the time stepping of every scene."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from softprint.runtime.experiment.schema.section import Count, NotNegative, Positive, Section, Vector


class ContactSpec(Section):
    """`[contact]`: penalty contact, cubic in the penetration depth, and regularised Coulomb friction."""

    model: Literal["penalty", "barrier"] = Field(
        "penalty",
        description="of full-space motions: a barrier lets nothing through, at many times the cost, and has no "
        "friction",
    )
    distance: Positive | None = Field(
        None, description="of the barrier [m]; a 33rd of the distance between surface nodes if absent"
    )
    stiffness: Positive = Field(1e10, description="k of the energy density k/3 depth^3 per area [N/m^4]")
    refinement: int = Field(
        2,
        ge=0,
        le=64,
        description="contact on surface facets, in full space at n points along an edge of each, and at tips and edges "
        "of colliders; 0: at nodes, between which thin limbs pass",
    )
    reduced_refinement: int = Field(
        1,
        ge=1,
        le=8,
        description="contact on facets in reduced models: points along an edge of each; 1: its middle and corners",
    )
    friction: NotNegative = Field(0.3, description="Coulomb coefficient; 0: frictionless")
    slip_velocity: Positive = Field(1e-3, description="below this speed friction sticks smoothly [m/s]")


class DynamicsSpec(Section):
    """`[dynamics]`: backward Euler by Newton's method. `gravity` also sets the dimension of the experiment."""

    gravity: Vector = Field(description="acceleration [m/s^2]: two numbers in 2D, three in 3D")
    time_step: Positive = Field(1 / 60, ge=1e-5, le=1.0, description="[s]")
    max_iterations: Count = Field(20, description="Newton iterations in one step")
    tolerance: Positive = Field(1e-4, description="relative residual below which a step has converged")
