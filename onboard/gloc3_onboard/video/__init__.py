"""Video of the cameras for stations: H.264 by PyAV, served over RTSP.

A camera without a viewer costs nothing. `streams` connects cameras, encoders and the server.
"""

__all__ = ["streams"]
