"""Plain classes that can be used and benchmarked alone: fusion, vision, scan matching, odometry, paths, mapping.

They are independent of components, topics and hosts.
"""
