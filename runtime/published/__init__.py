"""Reading and writing the data sets published with the papers of the thesis.

layout    the two HDF5 files, `meshes.h5` and `dataset.h5`: their content, and the assumptions
handles   the columns of a published basis that are points, and those that are frames
export    our body and truth in that layout
adopt     conversion of published files to a body, a truth file and an experiment for training
"""
