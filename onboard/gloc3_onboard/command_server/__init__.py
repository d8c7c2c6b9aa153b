"""The command interface server of a platform (paper §V): the one path from stations to components.

`server` is the component; `observing` (components and vehicle), `authority` (who may command), `mission_host` (the
executor) and `reporting` (what stations read) are its four parts, and `requests` admits what stations ask. `site` is
what the assembly gives it.
"""

__all__ = ["log_shelf", "site"]
