"""The emulated microcontroller: what stands between the world and the firmware."""
