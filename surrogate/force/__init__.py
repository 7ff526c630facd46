"""Learned contact forces: training data, loss and task."""
