"""The tables of an experiment file, one module for each section."""
