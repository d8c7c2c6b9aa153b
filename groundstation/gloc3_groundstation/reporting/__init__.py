"""Reports of a run of the station: lines for people and programs, and the outcome with its exit code.

The headless station and scripts use them; the schema of the lines is published.
"""

__all__ = ["lines", "narration", "outcomes", "schema"]
