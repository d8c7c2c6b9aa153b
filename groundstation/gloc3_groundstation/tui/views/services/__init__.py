"""The vehicle services as lines: parameters, plans, calibration, lists.

Pure functions of a view.
"""
