"""The falsifier: searches faults, times, seeds and weather for a flight that breaks an invariant, and shrinks it.

`invariant` is what packages and tests build on; `gloc3 prove` uses the search, the replay and the campaign.
"""

__all__ = ["campaign", "case", "fork", "found", "search", "standard_invariants", "static_flights", "static_proof"]
