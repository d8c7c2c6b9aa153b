"""How a range scanner moved, told from its scans alone.

`laser_odometer` is the estimator; the rest are its steps.
"""
