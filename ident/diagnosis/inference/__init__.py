"""What the scores mean: critical values, and the one decision rule."""
