"""Pictures and reports made from logs: paths, timelines, inspections.

matplotlib is imported where it draws.
"""

__all__ = ["beside_autopilot", "figure", "flight_path", "inspection_report", "plot", "recording", "timeline", "walls"]
