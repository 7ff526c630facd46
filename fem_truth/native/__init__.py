"""The inner loops of full-space solves in C, compiled for the machine at first use.

`elastic.c`: energy, gradient and Hessian of hyperelastic simplices, with the density in a header such as
`neo_hookean.h`. `blocks.c`: symmetric block matrices and the vector operations of projected conjugate gradients.
"""
