"""Softprint's runtime: reduced soft bodies, colliders, contact, learned corrections and dynamics in real time.

Users import `softprint`, which has the names that they need.
"""
