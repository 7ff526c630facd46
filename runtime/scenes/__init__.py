"""Scenes of an experiment: the models that play them, their motion files, and timings."""
