"""Simulated sensors: noisy readings of the truth."""
