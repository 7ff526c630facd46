"""The learner: truth files in, trained corrections out."""
