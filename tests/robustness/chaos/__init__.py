"""The real stack under fire: a seeded plan of faults, then every frame accounted for."""
