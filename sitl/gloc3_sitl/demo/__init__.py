"""The demonstration: simulated vehicle, onboard process and ground station as three real processes.

Its report is made from the logs that they leave.
"""

__all__ = ["demo"]
