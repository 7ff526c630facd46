"""The judge's verdict: held-out comparison of models with the full space, as a page and as JSON."""
