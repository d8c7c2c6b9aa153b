"""The onboard companion process: components of a vehicle, and the autopilot that they talk to."""
