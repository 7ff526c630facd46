"""Learned corrections: one folder each (`thesis5`, `thesis6`, `force`), their protocol, file and registry."""
