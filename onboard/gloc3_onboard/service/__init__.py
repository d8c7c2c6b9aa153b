"""The onboard process as a service of systemd: what its manager is told, its unit, its logs, its settings on demand."""
