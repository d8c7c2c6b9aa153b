"""All errors for which `gloc3 onboard` would refuse a platform file, and its presentation for people."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import msgspec

from gloc3.documents.document import Document, load_bytes
from gloc3.errors import Finding, InputError, NotFound, Refused
from gloc3.platform.places import host_names, place_of
from gloc3.platform.platform import Platform
from gloc3.platform.reader import check_platform, find_platform, namesakes, read_document
from gloc3_onboard.inputs import known_map
from gloc3_onboard.process.process import DEVICES
from gloc3_onboard.sensors.registry import parse_source, place_problem, sensor_of
from gloc3_onboard.sensors.rig import PlatformRig


class PlatformReport(msgspec.Struct, frozen=True, kw_only=True):
    """Findings in a platform file."""

    file: str
    findings: list[Finding]
    platform: Platform | None = None
    """None where it could not be read."""

    @property
    def is_ok(self) -> bool:
        """Whether `gloc3 onboard` would take it."""
        return not any(not finding.is_warning for finding in self.findings)

    def as_dict(self) -> dict[str, Any]:
        """The report as plain values, for JSON."""
        found = [msgspec.to_builtins(finding) for finding in self.findings]
        return {"file": self.file, "is_ok": self.is_ok, "findings": found}


def report_on(name: str) -> PlatformReport:
    """Checks a platform file, or an installed one by its name; never raises for what is in it.

    Findings that depend on this computer (an unplugged camera, for example) are warnings.

    Raises:
        NotFound: there is no such file or platform, or it cannot be read.
    """
    findings = namesakes(name)
    try:
        path = find_platform(name)
        document = read_document(load_bytes(path), str(path))
        platform = check_platform(document, is_loading_classes=True, devices=DEVICES, warn=findings.append)
    except NotFound:
        raise
    except InputError as error:
        return PlatformReport(file=name, findings=sorted([*findings, *error.findings]))
    findings += _sources(platform, document, path.parent)
    try:
        findings += PlatformRig(platform, path.parent).warnings
    except InputError as error:
        findings += _in_place(error.findings, document)
    try:
        known_map(platform, path.parent)
    except InputError as error:
        findings += [document.finding(("known_map",), str(each), is_warning=False) for each in error.findings]
    return PlatformReport(file=str(path), findings=sorted(findings), platform=platform)


def _sources(platform: Platform, document: Document, folder: Path) -> list[Finding]:
    found = []
    for name, text in platform.devices.items():
        if sensor_of(name) is None:
            continue
        try:
            problem, is_warning = place_problem(parse_source(name, text), folder), True
        except Refused as refusal:
            problem, is_warning = str(refusal), False
        if problem:
            message, _, hint = problem.partition("; ")
            found.append(document.finding(("devices", name), message, hint, is_warning=is_warning))
    return found


def _in_place(findings: Sequence[Finding], document: Document) -> list[Finding]:
    """Errors in a camera's calibration, placed at the camera's line."""
    placed = []
    for finding in findings:
        what, _, camera = finding.file.partition(": ")
        placed.append(document.finding((what, camera), finding.message) if what == "cameras" else finding)
    return placed


def described(platform: Platform) -> list[str]:
    """A platform in lines for a person."""
    limits, power = platform.limits, platform.power
    arms = "may arm it" if platform.arm else "may not arm it"
    heights = f"heights {limits.height_min_m:g} to {limits.height_max_m:g} m"
    speeds = f"{limits.speed_m_s:g} m/s, climbs {limits.climb_m_s:g} m/s"
    lines = [f"{platform.platform}: {platform.vehicle.type}, {platform.vehicle.mass_kg:g} kg, missions {arms}"]
    lines.append(f"  limits     {speeds}, {heights}, {limits.margin_text()} from the fence")
    if power is not None:
        lines.append(f"  battery    {power.battery_wh:g} Wh, {100.0 * power.reserve:.0f} % kept as reserve")
    stated = msgspec.to_builtins(platform.failsafes)
    words = [f"{name.replace('_', ' ')}: {row['action']}" for name, row in stated.items() if row]
    lines.append(f"  failsafes  {', '.join(words) or 'none'} (as set in the autopilot)")
    lines.append(f"  at a stop  {platform.on_stop}s in flight when the onboard process is stopped")
    for name, frame in platform.frames.items():
        latitude, longitude, altitude = frame.origin.geo
        lines.append(
            f"  frame      {name}: {latitude:.7f}, {longitude:.7f}, {altitude:g} m; x {frame.x_axis_bearing_deg:g}°"
        )
    lines.append(f"  can        {', '.join(platform.capabilities)}")
    lines += [f"  device     {name}: {source}" for name, source in platform.devices.items()]
    for host in host_names(platform):
        rows = [row for row in platform.components if place_of(platform, row).host == host]
        lines.append(f"  host       {host}: {len(rows)} components")
        for row in rows:
            notes = [f"{row.rate_hz:g} Hz"] if row.rate_hz else []
            notes += ["required"] if row.required else []
            notes += [f"stands by for {row.standby_for}"] if row.standby_for else []
            notes += [f"process {row.process}"] if row.process else []
            lines.append(f"    {row.name:<20} {_kind(row.class_name)}  {', '.join(notes)}")
    return lines


def _kind(class_name: str) -> str:
    return f"{class_name.rpartition(':')[2]:<26}"
