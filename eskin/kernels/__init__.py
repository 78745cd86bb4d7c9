"""Compiled ground under intervals and models: how kernels are made, and how they round.

Everything here is numba; nothing here knows an `eskin.Interval`.
"""
