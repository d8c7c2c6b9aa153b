"""Plain classes that can be used and benchmarked alone: fusion, vision, scan matching, odometry, paths, mapping.

None knows components, topics or hosts.
"""
