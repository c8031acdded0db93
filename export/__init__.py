"""From trained results to weights files (TZA), and golden vectors for the C core."""
