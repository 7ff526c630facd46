"""The object-centric external correction of thesis chapter 4: training data, loss and task."""
