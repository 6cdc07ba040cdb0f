"""Fuzzing of every reader: `python -m tests.fuzz --minutes 60`. Fixed seeds of it run in CI (`test_fuzz.py`)."""
