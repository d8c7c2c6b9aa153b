"""The panes of the services screen, one a file, and what they have in common."""
