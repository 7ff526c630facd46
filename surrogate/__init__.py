"""Training: reads truth files and writes trained corrections."""
