"""Full-space finite elements in DOLFINx: the ground truth for training and judging reduced models.

`FullSpaceElasticity` evaluates the elastic energy of a body and its derivatives, in compiled loops or from UFL forms;
`ConstrainedProblem` finds the full-space equilibrium with a given reduced state (thesis 5.3.3);
`FullSpaceSimulator` steps the same potentials in time without a subspace. Import them from their modules:
this package itself imports nothing, so that it can be imported on a machine without DOLFINx.
"""
