"""The onboard process as a service of systemd: what its manager is told, its unit, its logs, its settings on demand.

`service` is the life of the process under systemd, `install` writes the unit.
"""

__all__ = ["commands", "manager", "service"]
