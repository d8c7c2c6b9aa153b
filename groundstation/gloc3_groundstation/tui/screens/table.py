"""All screens of the station: a new one is a file and a row here."""

from typing import Final

from gloc3_groundstation.tui.screen import ScreenRow
from gloc3_groundstation.tui.screens.data import FlightDataScreen
from gloc3_groundstation.tui.screens.events import EventsScreen
from gloc3_groundstation.tui.screens.fleet import FleetScreen
from gloc3_groundstation.tui.screens.health import HealthScreen
from gloc3_groundstation.tui.screens.map import MapScreen
from gloc3_groundstation.tui.screens.mission import MissionScreen
from gloc3_groundstation.tui.screens.overview import OverviewScreen
from gloc3_groundstation.tui.screens.preflight import PreflightScreen
from gloc3_groundstation.tui.screens.sensors import SensorsScreen
from gloc3_groundstation.tui.screens.services import ServicesScreen

SCREENS: Final = (
    ScreenRow("overview", "1", "Overview", "fleet, vehicle in view, alerts and events", OverviewScreen),
    ScreenRow("health", "2", "Health", "every component, and where the data flow stops", HealthScreen),
    ScreenRow("mission", "3", "Mission", "tasks, actions and their states", MissionScreen),
    ScreenRow("map", "4", "Map", "vehicles, their trails and requested paths", MapScreen),
    ScreenRow("data", "5", "Data", "attitude, and setpoints against measured values", FlightDataScreen),
    ScreenRow("services", "6", "Services", "the autopilot's parameters, plans, logs, files, rates", ServicesScreen),
    ScreenRow("sensors", "7", "Sensors", "any topic of the vehicle: values, plots, pictures", SensorsScreen),
    ScreenRow("preflight", "8", "Checks", "pre-flight checks, and what to do", PreflightScreen),
    ScreenRow("events", "9", "Events", "all events, searched and exported", EventsScreen),
    ScreenRow("fleet", "0", "Fleet", "all vehicles and links; commands to several; control", FleetScreen),
)
