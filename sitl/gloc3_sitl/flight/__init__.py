"""The whole stack in one process on one virtual clock, for `gloc3 fly` and flight tests.

The only room that imports all three applications.
"""
