"""Softprint's own form: a network that corrects the contact forces of linear mechanics, for any collider."""
