"""Base parameters: numeric reduction, structural set, closed forms, expressions."""
