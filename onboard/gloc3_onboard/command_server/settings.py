"""Settings of the command interface server."""

from typing import Annotated

from gloc3.component.settings import Bounds, Settings


class ServerSettings(Settings, frozen=True):
    """How often it tells, and how long it listens."""

    summary_period_s: Annotated[float, Bounds(0.1, 10.0)] = 0.5
    """How often the components and the vehicle are summarised."""
    motion_period_s: Annotated[float, Bounds(0.1, 10.0)] = 0.5
    """How often it is told how the vehicle moves."""
    site_period_s: Annotated[float, Bounds(0.5, 60.0)] = 2.0
    """How often it is told where the vehicle's frame lies, and home."""
    grant_period_s: Annotated[float, Bounds(0.02, 1.0)] = 0.2
    """How often the owner of motion is repeated."""
    settle_s: Annotated[float, Bounds(0.0, 60.0)] = 1.0
    """After a restart: how long the autopilot is listened to before what was kept is taken up."""
    event_severity: Annotated[int, Bounds(0, 7)] = 5
    """Events of components that are at least so severe (MAV_SEVERITY) go to the stations."""
