"""The displacement field of thesis chapter 6: training data, loss and task."""
