"""The program `gloc3`: its subcommands come from entry points, so each package brings its own.

Help pages, narration on stderr, tables on stdout, and the words for wrong use.
"""

__all__ = ["counting", "narration", "port_advice", "start", "tables"]
