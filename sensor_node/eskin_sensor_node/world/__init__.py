"""What surrounds a node: scenarios, skins, recordings."""
