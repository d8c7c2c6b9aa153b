"""`gloc3 calibrate`: sensors calibrated from live data, folders and logs, shown, judged and written into a rig file.

`cli` holds the commands, one module each; the calculations are in `gloc3_onboard.algorithms.calibration`.
"""

__all__: list[str] = []
