"""The loops of full-space solves in C, compiled for the machine at first use.

`elastic.c`: energy, gradient and Hessian of hyperelastic simplices. `blocks.c`: symmetric block matrices and the
vector operations of projected conjugate gradients.
"""
