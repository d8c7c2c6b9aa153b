"""Dialogues over a screen that ask for more than yes or no."""
