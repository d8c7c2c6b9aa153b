"""Visual odometry: features, stereo geometry and odometers, each a plain class.

Stereo, ground and follower odometers, each built of small steps that can be used alone.
"""

__all__ = [
    "depth_points",
    "feature_message",
    "features",
    "ground_odometer",
    "mono_motion",
    "optical_follower",
    "picture",
    "pose_fit",
    "stereo_motion",
    "stereo_odometry",
    "stereo_rig",
]
