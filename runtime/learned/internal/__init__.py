"""Internal corrections: what a body without contact adds to its subspace, learned from its reduced state alone."""
