"""Readers of recorded data sets.

`laser_logs` and `stereo_set` open whatever form they find.
"""
