"""What must hold for the hosts and processes of a platform: they are there, and have what their components need."""

from collections.abc import Iterator

from gloc3.deployment_check import Problem
from gloc3.errors import nearest
from gloc3.places import Place, clock_host, host_names, place_of, tied_device
from gloc3.platform import Platform


def place_problems(platform: Platform) -> Iterator[Problem]:
    """The problems of the rows' `host` and `process`, each with its place in the file."""
    known = host_names(platform)
    owners: dict[str, tuple[str, Place]] = {}
    main = Place(clock_host(platform))
    by_name = {row.name: row for row in platform.components}
    for index, row in enumerate(platform.components):
        if row.host and row.host not in known:
            hint = nearest(row.host, known) if platform.hosts else "list the computers under hosts:"
            yield Problem(index, ("host",), f"the platform has no host {row.host!r}", hint)
            continue
        place = place_of(platform, row)
        device = tied_device(platform, row)
        if device and place != main:
            path = ("process",) if place.host == main.host else ("host",) if row.host else ()
            where = f"the main process of {main.host}"
            yield Problem(
                index, path, f"{row.name} needs the device {device!r}, which only {where} has", f"not {place}"
            )
        for used in () if device else sorted(set(row.devices.values()) & set(platform.devices)):
            owner, there = owners.setdefault(used, (row.name, place))
            if there != place:
                message = f"{owner} has the device {used!r} open in {there}, and {row.name} runs in {place}"
                yield Problem(index, ("devices",), message, "a device has one process: put both there")
        primary = by_name.get(row.standby_for or "")
        if primary is not None and row.process and place_of(platform, primary) == place:
            message = f"what ends the process {place} ends {primary.name} and this standby of it"
            yield Problem(index, ("process",), message, "give it another process", is_warning=True)
