"""Frames of films, off screen: the camera and the lights stay where they are while the body moves.

solid        bodies in 3D, with PyVista
flat         bodies in 2D, with matplotlib
rest_grid    lines of constant rest position on a surface, which show its strain
"""
