"""One file a kind of camera or of source of pictures: its URL scheme, its device, its replay, and the rows that declare them.

As in the room of the other sources: the registry finds every module here. A module lists `SENSORS` and `SOURCES`.
"""

__all__ = ["camera", "depth", "stereo"]
