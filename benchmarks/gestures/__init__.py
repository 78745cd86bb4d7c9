"""Gestures of emulated skins against their truth: see `benchmarks.gestures.__main__`."""
