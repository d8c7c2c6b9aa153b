"""The ground station of GLOC3: a command interface client with a terminal, and without."""
