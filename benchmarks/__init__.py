"""Speed, measured on the real parts: ``make bench``."""
