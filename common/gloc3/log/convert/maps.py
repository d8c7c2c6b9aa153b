"""A flight for maps: KML (Google Earth), GPX (navigation programs), GeoJSON (QGIS, the web).

All three have the path flown, the path requested, home, and the places of pictures. Heights are above mean sea level.
"""

import json
from collections.abc import Sequence
from datetime import UTC, datetime
from xml.etree.ElementTree import Element, ElementTree, SubElement, indent

from gloc3.errors import Refused
from gloc3.log.convert.flight import FlightMark, FlightSample, RecordedFlight
from gloc3.messages.frames import GeoPoint


def on_earth(flight: RecordedFlight, file: str) -> list[list[tuple[FlightSample, GeoPoint]]]:
    """The stretches of a flight with their geographic positions.

    Raises:
        Refused: the flight has no valid pose, or its frame no origin on Earth.
    """
    found = [[(sample, sample.geo) for sample in stretch if sample.geo is not None] for stretch in flight.stretches]
    if not flight.stretches:
        raise Refused(f"{file}: no valid pose was recorded")
    if not any(found):
        raise Refused(
            f"{file}: the flight is in a local frame without an origin on Earth. Set --origin LATITUDE,LONGITUDE,ALTITUDE, "
            "or `origin_geo` of the pose in the platform file; --to csv needs none"
        )
    return [stretch for stretch in found if stretch]


def kml(flight: RecordedFlight, file: str) -> bytes:
    """The flight as KML 2.2."""
    stretches = on_earth(flight, file)
    root = Element("kml", xmlns="http://www.opengis.net/kml/2.2")
    document = SubElement(root, "Document")
    SubElement(document, "name").text = _title(flight)
    for name, colour in (("flown", "ff2f6fd6"), ("requested", "ff9a9a9a")):  # alpha, blue, green, red
        style = SubElement(SubElement(document, "Style", id=name), "LineStyle")
        SubElement(style, "color").text = colour
        SubElement(style, "width").text = "3"
    for stretch in stretches:
        placemark = _line(document, "flown", [geo for _, geo in stretch])
        if flight.utc_offset_s is not None:
            span = Element("TimeSpan")
            SubElement(span, "begin").text = _utc(flight, stretch[0][0].t_s)
            SubElement(span, "end").text = _utc(flight, stretch[-1][0].t_s)
            placemark.insert(1, span)
    requested = _places(flight.requested)
    if requested:
        _line(document, "requested", [geo for _, geo in requested])
    for mark, geo in _places(flight.marks):
        placemark = SubElement(document, "Placemark")
        SubElement(placemark, "name").text = mark.name
        if mark.t_s is not None and flight.utc_offset_s is not None:
            SubElement(SubElement(placemark, "TimeStamp"), "when").text = _utc(flight, mark.t_s)
        point = SubElement(placemark, "Point")
        SubElement(point, "altitudeMode").text = "absolute"
        SubElement(point, "coordinates").text = _coordinates(geo)
    return _xml(root)


def gpx(flight: RecordedFlight, file: str) -> bytes:
    """The flight as GPX 1.1: a track with times, the requested path as a route, places as waypoints."""
    stretches = on_earth(flight, file)
    root = Element("gpx", xmlns="http://www.topografix.com/GPX/1/1", version="1.1", creator="GLOC3")
    for mark, geo in _places(flight.marks):
        _gpx_point(root, "wpt", geo, flight, mark.t_s, mark.name)
    requested = _places(flight.requested)
    if requested:
        route = SubElement(root, "rte")
        SubElement(route, "name").text = "requested"
        for _, geo in requested:
            _gpx_point(route, "rtept", geo, flight)
    track = SubElement(root, "trk")
    SubElement(track, "name").text = _title(flight)
    for stretch in stretches:
        segment = SubElement(track, "trkseg")
        for sample, geo in stretch:
            _gpx_point(segment, "trkpt", geo, flight, sample.t_s)
    return _xml(root)


def geojson(flight: RecordedFlight, file: str) -> bytes:
    """The flight as GeoJSON (RFC 7946); `coordTimes` are the times of the points, in UTC where it is known, else s."""
    features = []
    for stretch in on_earth(flight, file):
        times = [_utc(flight, sample.t_s) if flight.utc_offset_s is not None else sample.t_s for sample, _ in stretch]
        features.append(_feature("LineString", [_position(geo) for _, geo in stretch], "flown", coordTimes=times))
    requested = [_position(geo) for _, geo in _places(flight.requested)]
    if len(requested) > 1:
        features.append(_feature("LineString", requested, "requested"))
    for mark, geo in _places(flight.marks):
        time = {"t_s": mark.t_s} if mark.t_s is not None else {}
        features.append(_feature("Point", _position(geo), mark.name, **time))
    found = {"type": "FeatureCollection", "name": _title(flight), "features": features}
    return json.dumps(found, indent=1).encode()


def _title(flight: RecordedFlight) -> str:
    return f"{flight.platform}: {flight.mission}" if flight.mission else flight.platform


def _places(marks: Sequence[FlightMark]) -> list[tuple[FlightMark, GeoPoint]]:
    return [(mark, mark.geo) for mark in marks if mark.geo is not None]


def _utc(flight: RecordedFlight, t_s: float) -> str:
    moment = datetime.fromtimestamp(t_s + (flight.utc_offset_s or 0.0), UTC)
    return moment.isoformat(timespec="milliseconds").replace("+00:00", "Z")


def _coordinates(geo: GeoPoint) -> str:
    return f"{geo.longitude_deg:.8f},{geo.latitude_deg:.8f},{geo.altitude_m:.3f}"


def _position(geo: GeoPoint) -> list[float]:
    return [round(geo.longitude_deg, 8), round(geo.latitude_deg, 8), round(geo.altitude_m, 3)]


def _line(document: Element, name: str, points: Sequence[GeoPoint]) -> Element:
    placemark = SubElement(document, "Placemark")
    SubElement(placemark, "name").text = name
    SubElement(placemark, "styleUrl").text = f"#{name}"
    line = SubElement(placemark, "LineString")
    SubElement(line, "altitudeMode").text = "absolute"
    SubElement(line, "coordinates").text = " ".join(map(_coordinates, points))
    return placemark


def _gpx_point(
    parent: Element, kind: str, geo: GeoPoint, flight: RecordedFlight, t_s: float | None = None, name: str = ""
) -> None:
    point = SubElement(parent, kind, lat=f"{geo.latitude_deg:.8f}", lon=f"{geo.longitude_deg:.8f}")
    SubElement(point, "ele").text = f"{geo.altitude_m:.3f}"
    if t_s is not None and flight.utc_offset_s is not None:
        SubElement(point, "time").text = _utc(flight, t_s)
    if name:
        SubElement(point, "name").text = name


def _feature(kind: str, coordinates: object, name: str, **properties: object) -> dict[str, object]:
    return {
        "type": "Feature",
        "geometry": {"type": kind, "coordinates": coordinates},
        "properties": {"name": name, **properties},
    }


def _xml(root: Element) -> bytes:
    from io import BytesIO

    indent(root)
    out = BytesIO()
    ElementTree(root).write(out, encoding="utf-8", xml_declaration=True)
    return out.getvalue()
