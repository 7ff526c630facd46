"""Internal corrections without a network: modes, whose amplitudes are those of least elastic energy."""
