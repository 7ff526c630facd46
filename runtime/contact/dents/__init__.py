"""What is measured of a dent: its strain, how the body hardens under it, and what strain of the body does to it."""
