"""The command `softprint` and the framework of its verbs."""
