"""Tools on top of the emulator: labelled datasets and energy budgets."""
