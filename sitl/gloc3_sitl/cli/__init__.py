"""The commands of the simulation: `gloc3 sitl`, `fly`, `demo`, `relay` and `sitl record`.

Each command is a file.
"""
