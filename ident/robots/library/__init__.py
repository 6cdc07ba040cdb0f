"""Robots by name: built-in ones (a folder of data each, beside this file) and those of `example-robot-data`."""
