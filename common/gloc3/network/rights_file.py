"""The file `rights.yaml` beside a network file: who has which role for which vehicles, and what needs two persons."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from datetime import UTC, datetime, time, timedelta
from enum import StrEnum
from pathlib import Path
from typing import Final, NamedTuple

import msgspec

from gloc3.documents.document import Document, load_bytes, parse
from gloc3.documents.schema import check
from gloc3.errors import Finding, InputError, nearest
from gloc3.network.access import MemberRole

RIGHTS_FILE: Final = "rights.yaml"
ALL: Final = "all"
"""In place of a platform: every one."""


class Role(StrEnum):
    """Roles of a member for a vehicle."""

    OBSERVER = "observer"
    OPERATOR = "operator"
    COMMANDER = "commander"
    MAINTAINER = "maintainer"


class Right(StrEnum):
    """What a request needs."""

    CONTROL = "control"
    FLY = "fly"
    LOGS = "logs"
    OVERRULE = "overrule"
    APPOINT = "appoint"
    MAINTAIN = "maintain"
    TERMINATE = "terminate"
    FENCE_OFF = "fence_off"


ALONE: Final = (Right.CONTROL, Right.FLY)
"""What needs one person at most, so that each operator can stop the vehicle."""


class RightsEntry(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A role of a member."""

    member: str
    role: Role
    of: list[str]
    """Platforms, groups, or `all`."""
    may: list[str] = []
    """Capabilities that flying is limited to; empty for all."""
    until: str = ""
    """Last day, or time in UTC: 2026-12-01, or 2026-12-01T18:00."""

    @property
    def until_s(self) -> float | None:
        """Its end, UTC, s; None for no end."""
        if not self.until:
            return None
        end = datetime.fromisoformat(self.until)
        if len(self.until) == len("2026-12-01"):
            end = datetime.combine(end.date() + timedelta(days=1), time())
        return (end if end.tzinfo is not None else end.replace(tzinfo=UTC)).timestamp()


class RightsFile(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Content of `rights.yaml`. Members that it does not name are observers."""

    groups: dict[str, list[str]] = {}
    """Platforms, by the name of a group."""
    rights: list[RightsEntry]
    two_persons: list[Right] = []
    """What two persons have to request within half a minute; neither control nor fly."""


class ReadRights(NamedTuple):
    """A rights file that was read."""

    file: RightsFile | None
    """None where there is none."""
    warnings: list[Finding]
    """Names that nobody has: they give no rights, as after a member was revoked."""


def read_rights(path: Path, members: Mapping[str, MemberRole]) -> ReadRights:
    """Reads a rights file.

    Args:
        path: the file.
        members: the members that are known here.

    Raises:
        InputError: lists all errors.
    """
    if not path.exists():
        return ReadRights(None, [])
    document = parse(load_bytes(path), str(path))
    found: list[Finding] = []
    file = check(document.root, RightsFile, str(path), found)
    if file is not None:
        found += _findings(document, file, members)
    errors = [finding for finding in found if not finding.is_warning]
    if file is None or errors:
        raise InputError(sorted(errors))
    return ReadRights(file, sorted(found))


def _findings(document: Document, file: RightsFile, members: Mapping[str, MemberRole]) -> list[Finding]:
    found = []
    stations = [name for name, role in members.items() if role in (MemberRole.OPERATOR, MemberRole.OBSERVER)]
    platforms = {name.partition(".")[0] for name, role in members.items() if role is MemberRole.PLATFORM}
    for group, names in file.groups.items():
        if group in platforms or group == ALL:
            message = f"{group!r} is already the name of platforms"
            found.append(document.finding(("groups", group), message, at_key=True))
        found += _unknown(document, ("groups", group), names, platforms, "platform")
    for index, entry in enumerate(file.rights):
        place = ("rights", index)
        found += _unknown(document, place, [entry.member], stations, "station")
        found += _unknown(document, (*place, "of"), entry.of, {*platforms, *file.groups, ALL}, "platform or group")
        if members.get(entry.member) is MemberRole.OBSERVER and entry.role is not Role.OBSERVER:
            hint = "admit it again: gloc3 network add --renew --role operator"
            message = f"{entry.member} is an observer of the network, which carries no commands of it"
            found.append(document.finding((*place, "role"), message, hint, is_warning=True))
        try:
            _ = entry.until_s
        except ValueError:
            message = f"{entry.until!r} is no time"
            found.append(document.finding((*place, "until"), message, "write 2026-12-01, or 2026-12-01T18:00 in UTC"))
    for index, right in enumerate(file.two_persons):
        if right in ALONE:
            message = f"{right} cannot need two persons: each operator has to be able to stop the vehicle"
            found.append(document.finding(("two_persons", index), message))
    return found


def _unknown(
    document: Document, place: tuple[str | int, ...], names: list[str], known: Collection[str], kind: str
) -> list[Finding]:
    return [
        document.finding(
            place, f"there is no {kind} {name!r} in the network", nearest(name, sorted(known)), is_warning=True
        )
        for name in names
        if name not in known
    ]
