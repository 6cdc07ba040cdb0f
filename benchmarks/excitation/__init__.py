"""Designed motions, checked by another program path: clear of everything, within the limits, and nearly as good as without them."""
