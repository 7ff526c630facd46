"""Fields of a deformed body: strain, stress, volume change, contact pressure; and their files.

tensors    strain and stress of deformation gradients
deformed   all fields of one deformed body
vtu        VTK files of fields, and collections that ParaView plays
sources    the samples of a truth file and the frames of a motion as deformed bodies
"""
