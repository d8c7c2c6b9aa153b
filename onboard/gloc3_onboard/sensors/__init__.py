"""The devices of the onboard process as samplers see them, and whether they deliver.

Hardware, simulation and logs implement the same protocols.
"""
