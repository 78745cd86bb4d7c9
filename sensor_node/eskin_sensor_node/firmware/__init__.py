"""The control unit's program: plain Python that also runs under MicroPython, unchanged.

It imports nothing but `math` and `struct`, and of their functions uses only those that every port
computes alike: square roots, floors, exact powers of two. What it knows of the world are ADC codes,
its calibration, and its clock.
"""
