"""How files are written whole, checked when read, and protected from what is in them."""
