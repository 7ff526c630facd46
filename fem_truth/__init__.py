"""The judge: full-space finite elements in DOLFINx, the ground truth the reduced models learn from.

`FullSpaceElasticity` evaluates the elastic energy of a body and its derivatives, in compiled loops or from UFL forms;
`ConstrainedProblem` finds the full-space equilibrium that has a given reduced state (thesis 5.3.3);
`FullSpaceSimulator` steps the same potentials in time without any subspace. Import them from their modules:
this package itself imports nothing, so that its name can be looked up on a machine without DOLFINx.
"""
