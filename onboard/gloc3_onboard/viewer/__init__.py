"""Sends the platform's topics to stations on demand.

A component that subscribes only to topics leased by a station.
"""

__all__ = ["catalogue"]
