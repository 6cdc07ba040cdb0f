"""The version of the toolkit: read by the build, the command line, and every file that says what wrote it."""

__version__ = "0.2.0"
