"""Dead reckoning and wheel odometry, and odometer reports put end to end.

Plain classes, told the time.
"""
