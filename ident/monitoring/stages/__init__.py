"""Stages: a model on rows under a noise floor, with all that scores candidates beside it; what monitoring searches for changes with."""
