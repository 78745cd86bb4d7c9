"""The firmware's inner operations in C on an emulated Cortex-M33: counted, equal to Python's."""
