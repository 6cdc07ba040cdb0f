"""Regressors: rigid-body columns, base reduction, closed forms."""
