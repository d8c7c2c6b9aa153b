"""Cameras: lens models, mounts on a vehicle, and coverage of a wall by pictures.

Pure geometry, except for `opencv` (the only module that imports OpenCV), the frame stream between simulator and
companion, and picture files with their tags.
"""

__all__ = ["frame_stream", "geometry", "model", "opencv", "picture_file", "wall_coverage"]
