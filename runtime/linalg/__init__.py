"""Small dense linear algebra on the arrays of a step: products with handle rows, sparse directions, the chain rule."""
