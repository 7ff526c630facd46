"""The command `softprint` and the frame its verbs live in."""
