"""Linear mechanics of a body at rest, carried along with it: null-space compliance, surface compliance, static
condensation, corotation."""
