"""Pictures into motion: features, stereo geometry and odometers, each a plain class.

Stereo, ground and follower odometers, each built of small steps that can be used alone.
"""
