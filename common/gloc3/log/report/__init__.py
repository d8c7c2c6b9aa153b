"""Pictures and reports made from logs: paths, timelines, inspections.

matplotlib is imported where it draws.
"""
