"""Real autopilot firmwares on our physics, sensors and worlds."""
