"""One node: taxels sampled, measured and stored by the firmware on its machine."""
