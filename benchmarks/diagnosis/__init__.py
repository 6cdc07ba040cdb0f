"""Cases with a known fault, and what the diagnosis makes of them."""
