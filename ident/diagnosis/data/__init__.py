"""What a diagnosis looks at: measured motion and instrument, masks, rows in one band."""
