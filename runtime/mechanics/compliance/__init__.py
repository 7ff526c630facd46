"""How a body at rest gives way to forces in the null space of its reduced coordinates: G of all nodes
(`null_space_compliance.py`), compressed for forces on its surface (`surface_compliance.py`), among contact nodes
(`local_compliance.py`), and among points between them (`interpolated_compliance.py`)."""
