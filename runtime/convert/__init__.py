"""Motions and pictures for other programs: glTF, USD, point caches, OBJ sequences, films.

recorded     what can be converted: a motion file, or frames recorded in memory
sampling     which times of it
frames       its frames as surfaces, one at a time: what every format is written from
formats      file name ending -> writer
gltf, usd, point_cache, obj_sequence, film        one writer each
show         moving pictures in a notebook
"""
