"""The `[sampling]` table: the contacts that are solved for the truth file, and their tolerances (thesis 5.3.2)."""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from softprint.runtime.experiment.schema.section import Box, Count, NotNegative, Positive, Section, Share


class SolverSpec(Section):
    """`[sampling.solver]`: a sample has converged if its residual and decrement are both below these."""

    residual: Positive = Field(3e-4, description="relative residual of the projected forces")
    decrement: Positive = Field(1e-4, description="relative Newton decrement (energy)")
    max_iterations: Count = Field(60, description="Newton iterations of one solve")


class SamplingSpec(Section):
    """`[sampling]`: states x places x rotations contacts, each solved at `depths` depths. Without colliders, states
    alone."""

    collider: str = Field(
        "",
        description='name of the collider, or "library" for all its shapes, each with one contact at each place; '
        "optional if there is only one choice",
    )
    states: Count = Field(5, description="states of the body, chosen from the scenes of role `record`")
    record_with: Literal["bare", "condensed", "full", "forces"] | None = Field(
        None,
        description="model that plays the scenes of role `record`: the bare subspace, which is the default, with "
        "static condensation, or full space; or no scene, but random forces on a few handles at a time",
    )
    longest_move: Positive | None = Field(
        None,
        description='with record_with = "forces": how far the node that moves most moves at most, in sizes of the '
        "body; 0.1 if absent",
    )
    disturbed: Count | None = Field(
        None, description="states with handles moved at random, after each recorded one; none if absent"
    )
    disturbance: Positive | None = Field(
        None,
        description="of disturbed states: standard deviation of the moves, in sizes of the body; 0.01 if absent",
    )
    places: Count = Field(64, description="contact places, spread over the surface")
    test_places: Count | None = Field(
        None, description="library: contact places of the testing shapes; that of `places` if absent"
    )
    rotations: Annotated[int, Field(ge=0)] = Field(
        30,
        description="rotations of the collider, spread over SO(dim); 0: it is not rotated, and has one contact at each "
        "place",
    )
    depths: Count = Field(5, description="depths of each contact, from shallow to deep")
    max_depth: Positive = Field(
        0.01, description="deepest penetration of the rigid collider [m]; less if it is thinner"
    )
    depth_noise: Annotated[float, Field(ge=0, lt=0.5)] = Field(
        0.1, description="random shift of a depth, relative to the interval between depths"
    )
    repeat_share: Share = Field(0.03, description="share of contacts solved twice, for the label-noise floor")
    frame_clearance: NotNegative = Field(
        0.5, description="least distance of contact places from rigid frames, in sizes of the collider"
    )
    region: Box | None = Field(
        None, description="the part of the body at rest where contact places are [m]; everywhere if absent"
    )
    solver: SolverSpec = SolverSpec()

    @model_validator(mode="after")
    def _options_of_others(self) -> Self:
        if self.longest_move is not None and self.record_with != "forces":
            raise ValueError('longest_move is of states with record_with = "forces": leave it out')
        if self.disturbance is not None and not self.disturbed:
            raise ValueError(
                "disturbance is of disturbed states: say how many with disturbed, or leave it out"
            )
        return self
