"""The report: held-out comparison of models with full space, as a page and as JSON."""
