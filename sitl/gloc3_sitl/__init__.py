"""Simulation: vehicle, world, autopilot, faults, and flights of the whole stack."""
