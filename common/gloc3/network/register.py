"""The register of a network, kept beside its authority's key: all members, and the network files made from it."""

from __future__ import annotations

from collections.abc import Iterable
from datetime import datetime, timedelta
from pathlib import Path
from typing import Final

import msgspec
from msgspec.structs import replace

from gloc3.documents.document import dump, load
from gloc3.errors import Finding, InputError, Refused, nearest
from gloc3.network.access import Accepted, MemberRole, grants
from gloc3.network.authority import (
    AUTHORITY,
    CERTIFICATE,
    KEY,
    SIGNING,
    CertificateSubject,
    issue,
    make_authority,
    make_key,
    number_of,
    public_key,
    read_certificate,
)
from gloc3.network.enrolment import RequestedKeys
from gloc3.network.file import Unconfirmed, address_problem, host_of, member_problem
from gloc3.network.revocations import REVOCATIONS, sign_list
from gloc3.network.rights_file import RIGHTS_FILE, RightsFile, read_rights
from gloc3.store import replace_file

REGISTER: Final = "members.yaml"
NETWORK_FILE: Final = "network.yaml"


class NetworkMember(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True, omit_defaults=True):
    """A member of the network."""

    role: MemberRole
    certificate: str
    """The number of its one certificate that counts."""
    until: str
    """Day on which the certificate expires."""
    signs: str = ""
    """The number of the certificate of its key in a token; empty where it has none."""
    listen: list[str] = []
    """`HOST:PORT` that it opens."""
    reached_at: list[str] = []
    """`HOST:PORT` at which others reach it; empty where they are the same as its listen addresses."""
    to: list[str] = []
    """Members that it connects to; empty for the default of its role."""
    watches: list[str] = []
    """Platforms of which a station gets all details; empty for all."""
    is_revoked: bool = False


class Register(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True, omit_defaults=True):
    """All current and former members of the network."""

    network: str
    members: dict[str, NetworkMember] = {}
    confirmed_days: int = 0
    """So long a list of revoked members counts as up to date; 0 for no end."""
    unconfirmed: Unconfirmed = Unconfirmed.SAFETY
    """What stations may do with a platform whose list has ended."""

    def current(self) -> dict[str, NetworkMember]:
        """Those that have not been revoked."""
        return {name: member for name, member in self.members.items() if not member.is_revoked}

    def accepted(self, name: str) -> Accepted:
        """A member as others see it."""
        member = self.members[name]
        return Accepted(member=name, role=member.role, certificate=member.certificate, signs=member.signs)

    def connections(self, name: str) -> list[str]:
        """The addresses to which a member connects."""
        current = self.current()
        return [at for target in self.targets(name) for at in current[target].reached_at or current[target].listen]

    def peers(self) -> dict[str, list[str]]:
        """By member, those that connect to it, and to others as well; a router connects to one at a time."""
        found: dict[str, list[str]] = {}
        for other, each in self.current().items():
            targets = self.targets(other) if each.role is not MemberRole.ROUTER else []
            for name in targets if len(targets) > 1 else ():
                found.setdefault(name, []).append(other)
        return found

    def targets(self, name: str) -> list[str]:
        """The members to which a member connects.

        By default a platform's other hosts connect to its head, the first that listens or else the first, and everyone
        else to the first router. Without routers, stations connect to the heads that listen.
        """
        member, current = self.members[name], self.current()
        if member.to:
            return [target for target in member.to if target in current]
        routers = [host for host, each in current.items() if each.role is MemberRole.ROUTER]
        heads: dict[str, str] = {}
        hosts = [(host, each) for host, each in current.items() if each.role is MemberRole.PLATFORM]
        for host, _ in sorted(hosts, key=lambda entry: not entry[1].listen):
            heads.setdefault(host.partition(".")[0], host)
        head = heads.get(name.partition(".")[0], name) if member.role is MemberRole.PLATFORM else name
        if head != name:
            return [head] if current[head].listen else []
        if routers:
            return [] if routers[0] == name else routers[:1]
        return [] if member.role is MemberRole.PLATFORM else [each for each in heads.values() if current[each].listen]


def found(folder: Path, network: str, now: datetime, valid: timedelta) -> None:
    """Creates a network: its authority, and a register without members.

    Raises:
        Refused: there is one already.
    """
    if (folder / REGISTER).exists():
        raise Refused(f"{folder} already holds a network")
    folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    make_authority(folder, network, now, valid)
    _write(folder, Register(network=network), now)


def read_register(folder: Path) -> Register:
    """The register in a folder.

    Raises:
        InputError: there is none, or it is damaged.
    """
    return load(folder / REGISTER, Register)


def add(
    folder: Path,
    name: str,
    member: NetworkMember,
    now: datetime,
    valid: timedelta,
    *,
    is_renewed: bool,
    keys: RequestedKeys | None = None,
) -> list[str]:
    """Adds a member with a certificate, and rewrites all network files.

    Args:
        folder: the network.
        name: the member's name.
        member: its role and addresses.
        now: the validity starts then.
        valid: duration of the validity.
        is_renewed: whether it may be a member already, whose certificate is replaced.
        keys: its public keys; None to make a key in its folder here.

    Returns:
        The members whose files have changed, including itself.

    Raises:
        Refused: the name or an address is invalid, or the name is in use.
        InputError: the register or the authority cannot be used.
    """
    register = examine(folder, name, member, is_renewed=is_renewed)
    hosts = [host_of(address) for address in (*member.listen, *member.reached_at)]
    if keys is not None and keys.signing is not None and member.role is not MemberRole.OPERATOR:
        raise Refused(f"{name} signs no requests, so it needs no key in a token: that is for operators' stations")
    into = folder / name
    for former in (KEY, SIGNING):
        (into / former).unlink(missing_ok=True)
    keys = keys or RequestedKeys(make_key(into))
    number = issue(folder, into / CERTIFICATE, CertificateSubject(name, hosts, keys.link), now, valid)
    signs = ""
    if keys.signing is not None:
        signs = issue(folder, into / SIGNING, CertificateSubject(name, hosts, keys.signing), now, valid)
    entry = replace(member, certificate=number, signs=signs, until=f"{now + valid:%Y-%m-%d}")
    changed = replace(register, members={**register.members, name: entry})
    return _write(folder, changed)


def examine(folder: Path, name: str, member: NetworkMember, *, is_renewed: bool) -> Register:
    """Checks whether a member can be added; returns the register as it is.

    Args:
        folder: the network.
        name: the member's name.
        member: its role and addresses.
        is_renewed: whether it may be a member already.

    Raises:
        Refused: the name or an address is invalid, or the name is in use.
        InputError: the register cannot be used.
    """
    register = read_register(folder)
    problems = [member_problem(name, member.role), *map(address_problem, (*member.listen, *member.reached_at))]
    for problem in filter(None, problems):
        raise Refused(problem)
    if name in register.current() and not is_renewed:
        raise Refused(f"{name} is already a member; --renew gives it a new key and certificate")
    for target in member.to:
        if target not in register.current():
            raise Refused(f"there is no member {target!r}; {nearest(target, list(register.current()))}")
    platforms = [host.partition(".")[0] for host, one in register.current().items() if one.role is MemberRole.PLATFORM]
    for watched in member.watches:
        if watched not in platforms:
            raise Refused(f"there is no platform {watched!r}; {nearest(watched, platforms)}")
    if member.role is MemberRole.ROUTER and not member.listen:
        raise Refused("a router needs an address at which the others connect to it: --listen HOST:PORT")
    trial = replace(register, members={**register.members, name: member})
    if problem := _tree_problem(trial, name):
        raise Refused(problem)
    return register


def renew(folder: Path, name: str, now: datetime, valid: timedelta, keys: RequestedKeys | None = None) -> list[str]:
    """Gives a member a new certificate, with the same role and addresses, and rewrites all network files.

    Args:
        folder: the network.
        name: the member's name.
        now: the validity starts then.
        valid: duration of the validity.
        keys: its new public keys; None for a new key in its folder here, or for the same ones where its key is not here.

    Returns:
        The members whose files have changed, including itself.

    Raises:
        Refused: there is no such member.
        InputError: the register or the authority cannot be used.
    """
    member = read_register(folder).current().get(name)
    if member is None:
        raise Refused(f"there is no member {name!r}; {nearest(name, list(read_register(folder).current()))}")
    if keys is None and not (folder / name / KEY).exists():
        files = (CERTIFICATE, SIGNING) if member.signs else (CERTIFICATE,)
        keys = RequestedKeys(*(public_key(read_certificate(folder / name / file)) for file in files))
    return add(folder, name, member, now, valid, is_renewed=True, keys=keys)


def expiring(folder: Path, now: datetime, within: timedelta) -> list[str]:
    """The members whose certificates expire soon.

    Raises:
        InputError: the register or a certificate cannot be read.
    """
    ends = {name: folder / name / CERTIFICATE for name in read_register(folder).current()}
    return [name for name, path in ends.items() if read_certificate(path).not_valid_after_utc - now <= within]


def _tree_problem(register: Register, name: str) -> str:
    """Why a member's connections make no tree of the routers, whichever uplink each has; empty where they do."""
    targets, is_router = register.targets(name), register.members[name].role is MemberRole.ROUTER
    routers = [target for target in targets if register.members[target].role is MemberRole.ROUTER]
    if len(routers) > 1 and not is_router:
        return f"{name} would get messages twice: it may connect to one router, not to {' and '.join(routers)}"
    if is_router and len(routers) < len(targets):
        return f"the router {name} connects to another router, or to nothing"
    seen, ahead = set[str](), [(router, router) for router in routers]
    while ahead:
        at, by = ahead.pop()
        if at == name:
            return f"{name} would be connected in a circle, by {by}"
        if at not in seen:
            seen.add(at)
            ahead += [(target, at) for target in register.targets(at)]
    return ""


def revoke(folder: Path, name: str, now: datetime) -> list[str]:
    """Signs a new list of revoked members, removes a member from all network files, and rewrites them.

    Args:
        folder: the network.
        name: the member.
        now: time of signing.

    Returns:
        The members whose files have changed.

    Raises:
        Refused: there is no such member.
        InputError: the register cannot be used.
    """
    register = read_register(folder)
    if name not in register.current():
        raise Refused(f"there is no member {name!r}; {nearest(name, list(register.current()))}")
    changed = replace(register, members={**register.members, name: replace(register.members[name], is_revoked=True)})
    return _write(folder, changed, now)


def confirm(folder: Path, now: datetime, days: int | None = None, then: Unconfirmed | None = None) -> list[str]:
    """Signs the list of revoked members again, so that it counts as up to date for longer.

    Args:
        folder: the network.
        now: time of signing.
        days: so long this list and later ones count; 0 for no end, None for as it is.
        then: what stations may do with a platform afterwards; None for as it is.

    Returns:
        The members whose files have changed.

    Raises:
        InputError: the register cannot be used.
    """
    register = read_register(folder)
    changed = replace(
        register,
        confirmed_days=register.confirmed_days if days is None else days,
        unconfirmed=then or register.unconfirmed,
    )
    return _write(folder, changed, now)


def _sign(folder: Path, register: Register, now: datetime) -> None:
    """Signs the next list: what is in the list before, and all that are revoked in the register."""
    revoked = [
        _serial(folder / name / CERTIFICATE, member.certificate)
        for name, member in register.members.items()
        if member.is_revoked
    ]
    sign_list(folder, revoked, now, now + timedelta(days=register.confirmed_days) if register.confirmed_days else None)


def _serial(certificate: Path, number: str) -> int:
    """The serial number of a member's certificate, or else what its number tells of it."""
    try:
        serial = read_certificate(certificate).serial_number
    except InputError:
        return int(number, 16)
    return serial if number_of(serial) == number else int(number, 16)


def _write(folder: Path, register: Register, signed: datetime | None = None) -> list[str]:
    """Writes the register and all network files; returns the members whose files have changed.

    Args:
        folder: the network.
        register: its members.
        signed: time at which the next list of revoked members is signed; None for none.
    """
    roles = {name: member.role for name, member in register.current().items()}
    has_rights = read_rights(folder / RIGHTS_FILE, roles).file is not None  # errors come before anything is written
    if signed is not None:
        _sign(folder, register, signed)
    text = f"# The members of the network {register.network}. `gloc3 network` writes this file; authority.key stays here.\n"
    _replace(folder / REGISTER, text + dump(msgspec.to_builtins(register)))
    peers = register.peers()
    files = {
        name: _network_file(folder, register, name, peers.get(name, []), has_rights=has_rights)
        for name in register.current()
    }
    changed = [name for name, text in files.items() if _replace(folder / name / NETWORK_FILE, text)]
    return list(dict.fromkeys([*changed, *_copy_list(folder, register), *_copy_rights(folder, register)]))


def spread_rights(folder: Path) -> tuple[RightsFile, list[Finding], list[str]]:
    """Checks the network's `rights.yaml`, and copies it into the folders of the platforms' hosts.

    Returns:
        The rights, warnings, and the members whose copies have changed.

    Raises:
        Refused: there is no such file.
        InputError: it has errors, or the register cannot be used.
    """
    register = read_register(folder)
    found = read_rights(folder / RIGHTS_FILE, {name: one.role for name, one in register.current().items()})
    if found.file is None:
        raise Refused(f"{folder / RIGHTS_FILE} does not exist: without it, every operator may command every platform")
    return found.file, found.warnings, _write(folder, register)


def _copy_list(folder: Path, register: Register) -> list[str]:
    if not (folder / REVOCATIONS).exists():
        return []
    found = (folder / REVOCATIONS).read_text()
    return [name for name in register.current() if _replace(folder / name / REVOCATIONS, found)]


def _copy_rights(folder: Path, register: Register) -> list[str]:
    rights = folder / RIGHTS_FILE
    platforms = [name for name, member in register.current().items() if member.role is MemberRole.PLATFORM]
    if not rights.exists():
        return []
    return [name for name in platforms if _replace(folder / name / RIGHTS_FILE, rights.read_text())]


def _network_file(folder: Path, register: Register, name: str, peers: list[str], *, has_rights: bool) -> str:
    member, own = register.members[name], register.accepted(name)
    others = [register.accepted(other) for other in register.current() if other != name]
    entries = [own, *(other for other in others if grants(own, other))]
    listed = "".join(
        f"  - {{member: {_quoted(entry.member)}, role: {entry.role}, certificate: {_quoted(entry.certificate)}"
        + (f", signs: {_quoted(entry.signs)}}}\n" if entry.signs else "}\n")
        for entry in entries
    )
    rights = (
        f"""
# Who may what with the platform; `gloc3 network rights` writes it.
rights: {RIGHTS_FILE}
"""
        if has_rights and member.role is MemberRole.PLATFORM
        else ""
    )
    revocations = (
        f"""
# Who is revoked: signed by the authority; a newer list that comes over the network replaces it.
revocations: {REVOCATIONS}
"""
        if (folder / REVOCATIONS).exists()
        else ""
    )
    if revocations and member.role is MemberRole.PLATFORM:
        revocations += f"""\
# What stations may do when that list has ended: safety (look, hold, pause, abort, return, land), or all.
unconfirmed: {register.unconfirmed}
"""
    return f"""\
# The network file of {name}: its whole folder goes to the computer of {name}, and nowhere else.

network: {_quoted(register.network)}
member: {_quoted(name)}

# Beside this file; the key must be readable for its user alone.
certificate: {CERTIFICATE}
key: {KEY}
authority: {AUTHORITY}

# HOST:PORT that it opens for others, those to which it connects, and the members there; all of it is encrypted: TLS,
# or quic/HOST:PORT over UDP, for links that lose packets.
listen: [{", ".join(map(_quoted, member.listen))}]
connect: [{", ".join(map(_quoted, register.connections(name)))}]
uplinks: [{", ".join(map(_quoted, register.targets(name)))}]
# Those that connect to it, and to others as well.
peers: {_list(peers)}
{_region(register, name)}{rights}{revocations}
# Who is accepted, in which role, with which certificate; everyone else is refused.
# `gloc3 network show` shows the permissions. After a change: SIGHUP to the processes that use it.
accepts:
{listed}"""


def _region(register: Register, name: str) -> str:
    """Of a router, its vehicles; of a station, those that it watches in detail."""
    match register.members[name].role:
        case MemberRole.ROUTER:
            platforms = {
                other.partition(".")[0]
                for other, member in register.current().items()
                if member.role is MemberRole.PLATFORM and name in register.targets(other)
            }
            text = f"# The platforms that connect to it; it sums up their health once a second.\nregion: {_list(platforms)}\n"
        case MemberRole.OPERATOR | MemberRole.OBSERVER:
            watched = register.members[name].watches
            text = f"# Platforms of which it gets all details; of others it gets the routers' summaries. Empty: all.\nwatches: {_list(watched)}\n"
        case MemberRole.PLATFORM:
            return ""
    return f"\n{text}"


def _list(names: Iterable[str]) -> str:
    return f"[{', '.join(map(_quoted, sorted(names)))}]"


def _quoted(text: str) -> str:
    return msgspec.json.encode(text).decode()


def _replace(path: Path, text: str) -> bool:
    """Writes a file atomically; returns False where its content is unchanged."""
    if path.exists() and path.read_text() == text:
        return False
    replace_file(path, text.encode())
    return True
