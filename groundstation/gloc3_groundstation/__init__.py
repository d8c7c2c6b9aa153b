"""The ground station of GLOC3: a command interface client with a terminal, and without.

`assembly` builds a station from links, clock and storage, in wall time and in virtual time.
"""

__all__ = ["api", "assembly", "plug_ins"]
