"""Cameras: lens models, mounts on a vehicle, and coverage of a wall by pictures.

Pure geometry, except for `opencv` (the only module that imports OpenCV) and the frame stream between simulator and
companion.
"""

__all__ = ["frame_stream", "geometry", "model", "opencv", "wall_coverage"]
