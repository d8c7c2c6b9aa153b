"""The components of the example platforms, one a file: samplers (SS), processors (DP), controllers (CC), drivers (AD).

They are found through entry points and never import one another.
"""
