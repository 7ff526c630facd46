"""Truth files: full-space samples, written by `fem_truth` and used by `surrogate` for training."""
