"""The program `gloc3`: its subcommands come from entry points, so that each package adds its own.

Help pages, narration on stderr, tables on stdout, and usage errors.
"""

__all__ = ["counting", "narration", "port_advice", "start", "tables"]
