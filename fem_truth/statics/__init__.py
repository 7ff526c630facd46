"""Static equilibria in full space: Newton's method, stability, and equilibria with a given reduced state."""
