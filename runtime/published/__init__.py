"""The data sets published with the papers behind the thesis, read and written.

layout    the two HDF5 files, `meshes.h5` and `dataset.h5`: what is in them, and what had to be assumed
handles   which columns of a published basis are points and which are frames
export    our body and truth in that layout
adopt     published files as a body, a truth file and an experiment that training can use
"""
