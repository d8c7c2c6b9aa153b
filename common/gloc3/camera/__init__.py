"""Cameras: their lenses, how they sit on a vehicle, and what of a wall they have seen.

Pure geometry, but for `opencv`, the one importer of OpenCV, and the frame stream between simulator and companion.
"""

__all__ = ["frame_stream", "geometry", "model", "opencv", "wall_coverage"]
