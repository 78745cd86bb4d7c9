"""Hostile boxes for every model, against high precision (``python -m tests.robustness.boxes``)."""
