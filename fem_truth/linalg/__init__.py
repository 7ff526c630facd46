"""Linear algebra of full-space solves: sparse matrices of small blocks, the null space of a constraint, and projected
conjugate gradients."""
