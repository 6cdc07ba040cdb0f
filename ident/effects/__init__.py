"""What a joint, drive, sensor or load can do beside friction; one module a family."""
