"""TODO gloc3.store."""
