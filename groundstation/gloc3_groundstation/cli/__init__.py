"""The command `gloc3 station`, with a terminal or headless, and `gloc3 log pull`.

Options in, one session out.
"""
