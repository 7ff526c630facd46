"""The colours of bodies, colliders and errors, the same in all pictures."""

BODY = "#e58a6b"
SECTION = "#f0b39a"
COLLIDER = "#51617c"
ERROR_COLOURS = ("#fbeee0", "#f9c58d", "#f08a57", "#d5474f", "#93246a", "#3f0f58")
# Frames of a body: the palette of Okabe and Ito (2008), which colour-blind readers can distinguish.
FRAMES = ("#0072b2", "#009e73", "#cc79a7", "#e69f00", "#56b4e9")
POINTS = "#1b1b1f"
EDGES = "#7a3420"
