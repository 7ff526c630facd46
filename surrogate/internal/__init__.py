"""Training of internal corrections on the internal equilibria of a truth file."""
