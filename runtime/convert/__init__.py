"""Motions and pictures for other programs: glTF, USD, point caches, OBJ sequences, films.

frames          the frames of a motion as surfaces, one at a time: what every format is written from
formats         file name ending -> writer
gltf, usd, point_cache, obj_sequence, film        one writer each
recording       frames from a control loop of one's own, which convert and show as a motion file does
"""
