"""Contact with the displacement that the subspace cannot show condensed out: solver, warm start, sensitivity."""
