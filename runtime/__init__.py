"""Softprint's runtime: reduced soft bodies, colliders, learned corrections and their dynamics in real time."""
