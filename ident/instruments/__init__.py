"""Estimation by instruments: the measured motion beside the part of it that the reference drives, in rows of one band."""
