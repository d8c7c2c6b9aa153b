"""The onboard process as a systemd service: reports to its manager, unit, logs, reload of settings.

`service` is the life of the process under systemd, `install` writes the unit, `update` changes the version that it runs.
"""

__all__ = ["commands", "environments", "manager", "service", "status", "update"]
