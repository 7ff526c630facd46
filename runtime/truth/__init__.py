"""Truth files: full-space samples that `fem_truth` writes and `surrogate` learns from."""
