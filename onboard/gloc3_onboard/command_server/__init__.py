"""The command interface server of a platform (paper §V): the one path from stations to components.

`server` is the component and admits what stations ask; `observing` (components and vehicle), `authority` (who may
command), `mission_host` (the executor) and `reporting` (what stations read) are its four parts. `site` is what the
assembly gives it.
"""

__all__ = ["log_shelf", "site"]
