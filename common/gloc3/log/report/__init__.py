"""Pictures and reports made from logs: paths, timelines, inspections.

matplotlib is imported where it draws.
"""

__all__ = ["figure", "flight_path", "inspection_report", "plot", "recording", "timeline", "walls"]
