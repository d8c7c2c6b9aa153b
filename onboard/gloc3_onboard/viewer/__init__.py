"""Shows stations the topics of the platform, on demand.

A component: it listens only to topics that a station has leased.
"""

__all__ = ["catalogue"]
