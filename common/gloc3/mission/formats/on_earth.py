"""Puts a mission in a local frame onto the Earth, so that other programs and autopilots can take it as a plan."""

from dataclasses import replace

from msgspec import structs

from gloc3.messages.frames import LocalFrame, Vector3
from gloc3.mission.model.arguments import Arguments, FollowWaypoints, GoTo, Heading, Land, LookAt
from gloc3.mission.model.model import GEO, AreaFile, GeoCircle, GeofenceFile, Mission
from gloc3.mission.model.patterns import Pattern
from gloc3.mission.model.placement import HeightAbove, LocalPlacement, Point


def on_earth(mission: Mission, frame: LocalFrame) -> Mission:
    """The same mission in frame geo, with its heights counted from the sea.

    Args:
        mission: in a local frame.
        frame: that frame.
    """
    tasks = {
        name: replace(
            task,
            actions={
                action.name: replace(action, filled=_arguments(action.filled, frame))
                for action in task.actions.values()
            },
        )
        for name, task in mission.tasks.items()
    }
    geofence = geofence_on_earth(mission.geofence, frame) if mission.geofence is not None else None
    return replace(mission, frame=GEO, height_above=HeightAbove.SEA, tasks=tasks, geofence=geofence)


def _arguments(arguments: Arguments, frame: LocalFrame) -> Arguments:
    match arguments:
        case Pattern():
            return _arguments(arguments.path(LocalPlacement(frame)), frame)
        case FollowWaypoints(waypoints_m=waypoints) if waypoints is not None:
            places = tuple(_geo(place, frame) for place in waypoints)
            heading = _heading(arguments.heading, frame)
            return structs.replace(arguments, waypoints=places, waypoints_m=None, heading=heading)
        case GoTo(position_m=position) if position is not None:
            heading = _heading(arguments.heading, frame)
            return structs.replace(arguments, position=_geo(position, frame), position_m=None, heading=heading)
        case Land(at_m=at) if at is not None:
            return structs.replace(arguments, at=_geo((*at, 0.0), frame)[:2], at_m=None)
    return arguments


def _geo(position: Vector3, frame: LocalFrame) -> Vector3:
    place = frame.to_geo(position)
    return place.latitude_deg, place.longitude_deg, place.altitude_m


def _heading(heading: Heading, frame: LocalFrame) -> Heading:
    return LookAt(look_at=_geo(heading.look_at, frame)) if isinstance(heading, LookAt) else heading


def geofence_on_earth(geofence: GeofenceFile, frame: LocalFrame) -> GeofenceFile:
    """The same fence in frame geo; its ceiling stays a height above the frame's origin."""
    return GeofenceFile(
        polygon=_polygon(geofence, frame),
        circle=_circle(geofence, frame),
        ceiling_m=geofence.ceiling_m,
        keep_out=tuple(
            AreaFile(polygon=_polygon(area, frame), circle=_circle(area, frame)) for area in geofence.keep_out
        ),
    )


def _polygon(area: AreaFile, frame: LocalFrame) -> tuple[Point, ...] | None:
    return tuple(_geo((*corner, 0.0), frame)[:2] for corner in area.polygon_m or ()) or None


def _circle(area: AreaFile, frame: LocalFrame) -> GeoCircle | None:
    if area.circle_m is None:
        return None
    return GeoCircle(center=_geo((*area.circle_m.center_m, 0.0), frame)[:2], radius_m=area.circle_m.radius_m)
