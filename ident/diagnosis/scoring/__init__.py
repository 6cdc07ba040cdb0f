"""How well the model accounts for the rows: whitening, instrumental fit, scores of candidates."""
