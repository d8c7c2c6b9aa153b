"""The physics of simulated vehicles: multirotors, planes and quadplanes on JSBSim, rovers, vessels and underwater vehicles by our own equations.

Wind, water and ground act on all of them; `truth` is what a vehicle really does.
"""

__all__ = [
    "body",
    "fixed_wing",
    "ground",
    "jsbsim_body",
    "lift_rotors",
    "rover",
    "truth",
    "underwater",
    "vessel",
    "water",
    "wind",
]
