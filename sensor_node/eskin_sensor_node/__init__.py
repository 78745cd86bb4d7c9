"""The emulated microcontroller: physics, analogue chain, firmware, flash, publisher."""
