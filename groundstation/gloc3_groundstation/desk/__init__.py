"""The operator's actions: missions, components, the fleet, vehicle services, teleoperation.

A desk works on a station; screens and the headless station call it.
"""

__all__ = [
    "autopilot_desk",
    "component_desk",
    "control",
    "desk",
    "events_desk",
    "flights",
    "go_here",
    "mission_desk",
    "parameter_desk",
    "plan_desk",
    "preflight_desk",
    "service_jobs",
    "services_desk",
    "stick_flight",
    "teleoperation",
    "vehicle_commands",
    "vehicle_desk",
]
