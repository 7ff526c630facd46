"""The object-centric external correction of thesis chapter 4: inputs, model and correction."""
