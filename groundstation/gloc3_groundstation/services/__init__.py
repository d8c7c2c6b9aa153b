"""Vehicle services: commands, parameters, plans, logs, files, calibration, rates and console of any PX4 or ArduPilot vehicle.

Desks start them as jobs; each service has one path to the vehicle.
"""

__all__ = [
    "actions",
    "console",
    "files",
    "logs",
    "machines",
    "motor_test",
    "parameter_table",
    "parameters",
    "plan_items",
    "plans",
    "progress",
    "rates",
    "saving",
    "snapshot",
    "sticks",
    "vehicle",
]
