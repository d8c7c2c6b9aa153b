"""Simulated sensors: noisy readings of the truth.

`suite` samples them together; each has a rate, a latency, noise and faults.
"""
