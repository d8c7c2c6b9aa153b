"""Checks of the other hosts of a platform: they are here, speak as we do, and know what time it is."""

from collections.abc import Iterator
from typing import Final

from gloc3.messages.hosts import HostStatus
from gloc3.messages.preflight import Check, Group, Verdict
from gloc3.messages.software import Software, compared
from gloc3.platform.places import clock_host, host_names, place_of
from gloc3_onboard.checks.readings import Readings

UNSURE_S: Final = 0.02
"""A time that is known no better than that makes old data look new, and new data old."""
FORGOTTEN_S: Final = 30.0
"""So long a host may rely on its last answer from the clock host."""


def host_checks(readings: Readings) -> Iterator[Check]:
    """A line for each host beside the clock host, and one for its time."""
    platform = readings.platform
    if readings.components is None:
        return
    for host in host_names(platform):
        if host == clock_host(platform):
            continue
        title, found = f"host {host}", readings.hosts.get(host)
        if found is None or not found.is_here:
            rows = [row for row in platform.components if place_of(platform, row).host == host]
            verdict = Verdict.RED if any(row.required for row in rows) else Verdict.WARNING
            advice = f"start gloc3 onboard there with --host {host}, and look at the network between"
            yield Check(Group.COMPONENTS, title, verdict, "nothing is heard of it", advice)
        elif found.status is not None:
            status = found.status
            software = Software(status.version, status.protocol)
            yield compared(title, software, "there", Group.COMPONENTS)
            yield _time(title, status)


def _time(title: str, status: HostStatus) -> Check:
    known = f"to within {status.clock_bound_s * 1e3:.1f} ms, asked {status.clock_age_s:.0f} s ago"
    if status.clock_bound_s > UNSURE_S or status.clock_age_s > FORGOTTEN_S:
        advice = "look at the network between the hosts: answers are late, or do not come"
        return Check(Group.COMPONENTS, f"{title}: time", Verdict.WARNING, known, advice)
    return Check(Group.COMPONENTS, f"{title}: time", Verdict.OK, known)
