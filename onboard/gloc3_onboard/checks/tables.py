"""The table of parameters of an autopilot, by its family and its class of vehicle."""

from gloc3.messages.vehicle import Style, VehicleClass
from gloc3_onboard.checks import parameters_ardupilot, parameters_px4
from gloc3_onboard.checks.parameters import StyleTable


def table_of(style: Style, vehicle: VehicleClass | None = None) -> StyleTable:
    """The table; a copter's where the class is not known."""
    tables = parameters_px4.CLASSES if style is Style.PX4 else parameters_ardupilot.CLASSES
    return tables.get(vehicle or VehicleClass.COPTER) or tables[VehicleClass.COPTER]
