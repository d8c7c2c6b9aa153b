"""How a range scanner moved, told from its scans alone."""
