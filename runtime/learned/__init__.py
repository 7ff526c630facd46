"""Learned corrections: one folder each (`thesis5`, `thesis6`, `force`), and their protocol, file and registry."""
