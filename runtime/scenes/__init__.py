"""Scenes of an experiment: what plays them, what they leave in motion files, how long it takes."""
