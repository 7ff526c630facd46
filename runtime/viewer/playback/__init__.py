"""Motion and truth files in the window."""
