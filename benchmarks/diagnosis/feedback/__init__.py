"""A world under feedback: what a controller answers is in the motion, and nothing that is missing need be there."""
