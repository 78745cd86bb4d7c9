"""One node of a large skin: stretches of time become frames, one a page."""
