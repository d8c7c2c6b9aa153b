"""The physics of simulated vehicles: multirotors and planes on JSBSim, rovers, vessels and underwater vehicles by our own equations.

Wind, water and ground act on all of them; `truth` is what a vehicle really does.
"""
