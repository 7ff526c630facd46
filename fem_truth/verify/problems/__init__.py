"""Problems with a known solution, and the independent solvers that the cases compare with."""
