"""The widgets of the terminal: panels of lines, lists, pictures, editors, tables.

Each draws only what has changed.
"""
