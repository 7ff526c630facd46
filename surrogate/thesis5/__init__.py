"""The contact-centric displacement field of thesis chapter 5: training data, loss and task."""
