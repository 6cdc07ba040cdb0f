"""Readers of log files: names in, columns out."""
