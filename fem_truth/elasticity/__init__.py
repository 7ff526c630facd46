"""The elastic energy of the full space and its derivatives: from compiled loops, or from UFL forms by DOLFINx.

`full_space_elasticity.py` is what all others use; `dolfinx_version.py` is the one module that depends on the version of
DOLFINx.
"""
