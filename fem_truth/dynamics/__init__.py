"""Motion in full space: backward Euler over the terms of the total energy."""
