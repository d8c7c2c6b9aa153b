"""Faults of a simulated flight as data, and their effects on devices, messages, components and links.

`faults` reads them from text and schedules them.
"""

__all__ = ["device_faults", "fault_menu", "fault_text", "faults", "injection", "sabotage"]
