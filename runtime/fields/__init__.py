"""Fields that follow from a deformed body: strain, stress, volume change, contact pressure; and their files.

tensors    strain and stress of deformation gradients
deformed   all fields of one deformed body
vtu        VTK files of them, and collections that ParaView plays
sources    the samples of a truth file and the frames of a motion as deformed bodies
"""
