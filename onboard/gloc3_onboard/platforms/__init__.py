"""The platform files that ship with GLOC3."""
