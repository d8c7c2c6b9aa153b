"""The pre-flight checks of a platform: pure functions from readings to lines of the list.

`checklist` makes the whole list from `readings`; the tables name the relevant parameters.
"""

__all__ = ["checklist", "failsafes", "parameters", "readings", "tables"]
