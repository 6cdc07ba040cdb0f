"""How time and memory grow with what is given, and what becomes of runs that write to one place."""
