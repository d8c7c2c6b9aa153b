"""MAVSDK in a process of its own, behind the station's link: it commands vehicles of any make by its plugins.

Services ask `behind_link` for actions; nothing else knows of the process.
"""

__all__ = ["behind_link", "messages"]
