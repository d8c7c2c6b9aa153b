"""Vehicle services: parameters, plans, logs, files, calibration and message rates of any PX4 or ArduPilot vehicle."""
