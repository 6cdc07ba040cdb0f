"""What could be missing: effects of the catalogue and generic shapes, as columns."""
