"""Helpers without a place of their own: files, JSON, TOML, text, linear algebra, fixed points."""
