"""The command `gloc3 network`: creates and checks the network of platforms and stations."""

from __future__ import annotations

import asyncio
import sys
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from datetime import timedelta
from pathlib import Path
from typing import Annotated

import msgspec
from cyclopts import App, Parameter

from gloc3.cli.counting import counted
from gloc3.cli.narration import narrate
from gloc3.clock import utc_now, utc_text
from gloc3.errors import NoContact, Refused
from gloc3.installed import installed_points
from gloc3.messages.envelope import Severity
from gloc3.network import register, spreading
from gloc3.network.access import MemberRole, access_control, grants
from gloc3.network.authority import read_certificate
from gloc3.network.enrolment import REQUEST, fingerprint, make_request, read_request, requested_keys
from gloc3.network.file import Membership, Unconfirmed, address_problem, member_problem, read_network
from gloc3.network.revocations import REVOCATIONS, read_list
from gloc3.network.rights import MEANINGS, Rights
from gloc3.network.rights_file import Right, RightsFile

app = App(
    name="gloc3 network",
    help="""Make the network of platforms and stations: who is on it, and what each may do. Every link is encrypted, and
    both ends show a certificate of the network's own authority; the rules follow from the role that it stands for.

    For example, for a vehicle with two computers, an operator and an observer:

    - `gloc3 network init yard`
    - `gloc3 network add yard pelican.main --role platform --listen 192.168.1.10:7447`
    - `gloc3 network add yard pelican.vision --role platform`
    - `gloc3 network add yard alice --role operator`
    - `gloc3 network add yard bob --role observer`
    - copy the folder yard/pelican.main to that computer, yard/alice to hers, and so on (`gloc3 network request` first, and
      no key is copied)
    - `gloc3 onboard pelican.yaml --host main --network pelican.main/network.yaml`
    - or, instead of copying: `gloc3 network invite yard alice --role operator --at 192.168.1.5:7448`, and on her computer
      the command that it prints
    - `gloc3 network router coast/network.yaml`, on a computer that connects many members
    - `gloc3 network revoke yard bob`
    - `gloc3 network push alice/network.yaml yard/revocations.pem`, so that all members learn it
    - `gloc3 network inventory alice/network.yaml`: versions, hours and batteries of all vehicles
    - `gloc3 network rights yard`, after yard/rights.yaml was written: who may what with which vehicle

    Exit codes: 0 done; 1 nobody was reached, or some members
    have not got the list; 2 wrong use, or a file with mistakes.""",
    help_format="markdown",
    version_flags=[],
)

for _point in installed_points("gloc3.network_commands"):
    app.command(_point.load(), name=_point.name)

Days = Annotated[int, Parameter(help="How long the certificate is valid, in days.")]
STATIONS = (MemberRole.OPERATOR, MemberRole.OBSERVER)
AUTHORITY_DAYS = 3650
MEMBER_DAYS = 365
MOST_DAYS = 36500
MOST_WAIT_S = 600.0
MOST_MINUTES = 1440.0


@app.command
def init(folder: Path, /, *, name: str | None = None, days: Days = AUTHORITY_DAYS) -> int:
    """Create a network without members: its certificate authority, whose key stays in this folder.

    Args:
        folder: The folder to create; its name is the network's.
        name: The network's name, if not the folder's.
        days: How long the authority is valid.
    """
    folder = folder.expanduser()
    _check(days)
    register.found(folder, name or folder.absolute().name, utc_now(), timedelta(days=days))
    narrate(f"{folder} holds a network; keep authority.key secret: anyone with it can add members")
    return 0


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class MemberOptions:
    """What a new member is, one option for each field."""

    role: MemberRole
    """What it may do: platform, operator, observer or router."""
    listen: Annotated[list[str] | None, Parameter(negative=())] = None
    """HOST:PORT that it opens for others, or quic/HOST:PORT, over UDP, for links that lose packets; may be given again.
    The first host of a platform that listens is the one to which its other hosts and the stations connect."""
    reached_at: Annotated[list[str] | None, Parameter(negative=())] = None
    """HOST:PORT at which others reach it, if different (0.0.0.0, or behind a router)."""
    to: Annotated[list[str] | None, Parameter(negative=())] = None
    """The member that it connects to, if not the default; may be given again. A member connects to one router at most; for
    a router, further ones are alternatives, tried when the present one is lost."""
    watch: Annotated[list[str] | None, Parameter(negative=())] = None
    """Of a station: a platform of which it gets all details, and of others only what routers sum up; may be given again.
    Without it: all details of all platforms."""
    days: Days = MEMBER_DAYS
    """How long its certificate is valid."""
    renew: Annotated[bool, Parameter(negative=())] = False
    """Give an existing member another key and certificate; the former ones are no longer valid."""

    def entry(self) -> register.NetworkMember:
        """The member for the register.

        Raises:
            Refused: a value is outside its limits.
        """
        _check(self.days)
        return register.NetworkMember(
            role=self.role,
            certificate="",
            until="",
            listen=self.listen or [],
            reached_at=self.reached_at or [],
            to=self.to or [],
            watches=self.watch or [],
        )


@app.command
def add(folder: Path, member: str, /, *, options: MemberOptions, request: Path | None = None) -> int:
    """Add a member: make its folder with key, certificate and network file, and rewrite the others' files.

    Args:
        folder: The network.
        member: PLATFORM.HOST for a computer of a platform, a name without a dot for a station or a router.
        options: What it is.
        request: The member's request, from `gloc3 network request`: its key stays on its own computer.
    """
    folder = folder.expanduser()
    entry, valid, is_renewed = options.entry(), timedelta(days=options.days), options.renew
    keys = None if request is None else read_request(request.expanduser(), member)
    changed = register.add(folder, member, entry, utc_now(), valid, is_renewed=is_renewed, keys=keys)
    narrate(f"{folder / member} is for {member} only; its certificate is valid for {options.days} days")
    if keys is not None:
        narrate(f"fingerprint of the key: {fingerprint(keys)}; it has to be the one that {member} reads out")
    if not entry.listen and not register.read_register(folder).connections(member):
        narrate(f"no member listens yet for {member} to connect to: add a platform with --listen")
    _narrate(name for name in changed if name != member)
    return 0


@app.command
def request(folder: Path, member: str, /, *, token: str = "") -> int:
    """Make a member's key on its own computer, and a request to add it: no key is ever copied.

    Send FOLDER/request.pem to the person with the network's authority, who adds it: `gloc3 network add yard alice --role
    operator --request request.pem`. Compare the fingerprints by voice. Then copy the files in yard/alice to FOLDER.

    Args:
        folder: Where the key is, or is to be.
        member: PLATFORM.HOST, or a name without a dot.
        token: Sign requests with a key in a TPM, a smart card or a USB token, made there if there is none: a PKCS #11 URI,
            such as pkcs11:token=alice?module-path=/usr/lib/softhsm/libsofthsm2.so
    """
    folder = folder.expanduser()
    role = MemberRole.PLATFORM if "." in member else MemberRole.OPERATOR
    if problem := member_problem(member, role):
        raise Refused(problem)
    digits = make_request(folder, member, token)
    narrate(f"{folder / REQUEST} can be sent openly; fingerprint of the key: {digits}")
    return 0


@app.command
def invite(folder: Path, member: str, /, *, options: MemberOptions, at: str, minutes: float = 15.0) -> int:
    """Invite a member by a one-time code, with which it gets its certificate over the network: `gloc3 network join`.

    Prints the code and waits for the newcomer, who makes its own key. Anyone who has the code becomes the member: give it to
    the right person only, such as by phone. It ends with its first use, after five wrong ones, and after its time.

    Args:
        folder: The network.
        member: PLATFORM.HOST for a computer of a platform, a name without a dot for a station or a router.
        options: What it is.
        at: HOST:PORT of this computer at which the newcomer reaches it; it is open meanwhile.
        minutes: How long the code is valid.
    """
    from gloc3.network.invitations import Invitation, files_of

    folder = folder.expanduser()
    entry, valid, is_renewed = options.entry(), timedelta(days=options.days), options.renew
    if not 0.0 < minutes <= MOST_MINUTES:
        raise Refused(f"--minutes must be above 0 and at most {MOST_MINUTES:.0f}")
    host, port = _address(at)
    register.examine(folder, member, entry, is_renewed=is_renewed)
    changed: list[str] = []

    def enrol(request: bytes) -> dict[str, str]:
        keys = requested_keys(request, member, "the newcomer's request")
        changed[:] = register.add(folder, member, entry, utc_now(), valid, is_renewed=is_renewed, keys=keys)
        narrate(f"{member} has joined; fingerprint of its key: {fingerprint(keys)}")
        return files_of(folder / member)

    def opened(code: str, port: int) -> None:
        sys.stdout.write(f"gloc3 network join {code}@{at.rpartition(':')[0]}:{port}\n")
        sys.stdout.flush()
        narrate(f"waiting {minutes:g} min for {member}; anyone who types this becomes {member}")

    asyncio.run(Invitation(member, enrol, narrate).serve(host, port, minutes * 60.0, opened))
    _narrate(name for name in changed if name != member)
    return 0


@app.command
def join(invitation: str, /, *, out: Path | None = None, token: str = "") -> int:
    """Join a network by a one-time code: make a key here, and get its certificate and files.

    Args:
        invitation: CODE@HOST:PORT, as `gloc3 network invite` prints it.
        out: The folder to create for the files; default: the member's name.
        token: The PKCS #11 URI of a token whose key signs this station's requests, as for `gloc3 network request`.
    """
    from gloc3.network.invitations import OneTimeCode, join

    text, at, place = invitation.rpartition("@")
    if not at:
        raise Refused(f"{invitation!r} is no invitation: CODE@HOST:PORT, as gloc3 network invite prints it")
    host, port = _address(place)
    into = asyncio.run(join(OneTimeCode.read(text), host, port, None if out is None else out.expanduser(), token))
    membership = _read(into / register.NETWORK_FILE)
    narrate(f"{into} is of {membership.file.member}, {membership.file.own.role}, on {membership.file.network}")
    return 0


@app.command
def renew(
    folder: Path,
    members: Annotated[list[str] | None, Parameter(negative=())] = None,
    /,
    *,
    days: Days = MEMBER_DAYS,
    within: int = 30,
) -> int:
    """Renew certificates, with the same roles and addresses; keys on the members' own computers stay as they are.

    Args:
        folder: The network.
        members: The members; all whose certificates expire soon if left out.
        days: How long the certificates are valid.
        within: Without members: renew what expires within so many days.
    """
    folder = folder.expanduser()
    _check(days)
    names = members or register.expiring(folder, utc_now(), timedelta(days=within))
    changed: list[str] = []
    for name in names:
        changed += register.renew(folder, name, utc_now(), timedelta(days=days))
    narrate(f"renewed: {', '.join(names)}" if names else f"nothing expires within {counted(within, 'day')}")
    _narrate(dict.fromkeys(changed))
    return 0


@app.command
def revoke(folder: Path, member: str, /) -> int:
    """Revoke a member: sign a new list of revoked members, and remove it from all network files.

    Bring the list to the members by `gloc3 network push`, or copy the files.

    Args:
        folder: The network.
        member: The member to revoke.
    """
    folder = folder.expanduser()
    register.revoke(folder, member, utc_now())
    narrate(f"{member} is revoked and removed from all network files; push {folder / REVOCATIONS} to the members")
    return 0


@app.command
def confirm(folder: Path, /, *, days: int | None = None, then: Unconfirmed | None = None) -> int:
    """Sign the list of revoked members again, so that it counts as up to date; push it afterwards.

    Args:
        folder: The network.
        days: From now on, lists count for so many days; 0 for no end, as at first.
        then: What stations may do with a platform whose list has ended: safety (look, hold, pause, abort, return, land), or all.
    """
    folder = folder.expanduser()
    if days is not None and not 0 <= days <= MOST_DAYS:
        raise Refused(f"--days must be from 0 to {MOST_DAYS}")
    changed = register.confirm(folder, utc_now(), days, then)
    narrate(f"{folder / REVOCATIONS} is signed; push it to the members")
    if then is not None:
        _narrate(changed)
    return 0


@app.command
def push(file: Path, revocations: Path | None = None, /, *, wait: float = 15.0) -> int:
    """Send the newest list of revoked members to all members: each keeps it, and passes it on.

    Joins the network as a member, whose own process must not run meanwhile. Prints who has the list.

    Args:
        file: The member's network.yaml.
        revocations: The list, if it is not beside it: revocations.pem of the network's folder.
        wait: Longest time until all members in sight have it, s.
    """
    file = file.expanduser()
    if not 0.0 < wait <= MOST_WAIT_S:
        raise Refused(f"--wait must be above 0 and at most {MOST_WAIT_S:.0f} s")
    membership = _read(file)
    if revocations is not None:
        authority = read_certificate(file.parent / membership.file.authority)
        membership = read_network(file, utc_now(), read_list(revocations.expanduser(), authority))
    found = asyncio.run(spreading.push(membership, wait))
    assert membership.revocations is not None
    number = membership.revocations.number
    for member, known in sorted(found.items()):
        sys.stdout.write(f"{member}: list {known}{'' if known >= number else ', older'}\n")
    if not found:
        raise NoContact(
            f"no member was reached within {wait:g} s at {', '.join(membership.file.connect) or 'its address'}"
        )
    late = [member for member, known in found.items() if known < number]
    narrate(f"{membership.revocations}: {counted(len(found) - len(late), 'member')} have it")
    return 1 if late else 0


@app.command
def rights(folder: Path, /) -> int:
    """Check FOLDER/rights.yaml, show what it permits, and copy it into the folders of the platforms.

    Without this file, every operator may command every platform. With it, each station may what its roles permit:

    - `groups: {coast: [pelican, heron]}`
    - `rights: [{member: alice, role: operator, of: [coast]}, {member: carol, role: commander, of: [all]}]`
    - `two_persons: [terminate, fence_off]`

    A role may have `may:`, a list of capabilities, and `until:`, its last day or the time in UTC.

    Args:
        folder: The network.
    """
    folder = folder.expanduser()
    file, warnings, changed = register.spread_rights(folder)
    current = register.read_register(folder).current()
    platforms = sorted({name.partition(".")[0] for name, one in current.items() if one.role is MemberRole.PLATFORM})
    stations = [name for name, one in current.items() if one.role in STATIONS]
    for warning in warnings:
        narrate(str(warning), Severity.WARNING)
    for platform in platforms:
        sys.stdout.write("\n".join([platform, *_rights_lines(file, platform, stations)]) + "\n")
    _narrate(changed)
    return 2 if warnings else 0


@app.command
def router(file: Path, /) -> int:
    """Forward messages between the members that connect to this router, and its uplink, until it is ended.

    Add it with `gloc3 network add yard coast --role router --listen 10.0.0.5:7447`. Members added afterwards connect to
    the first router; `--to` chooses another, also for routers, which form a tree. SIGHUP has it read its file again.

    Args:
        file: The router's network.yaml.
    """
    from gloc3.network.router import run_router

    asyncio.run(run_router(file.expanduser()))
    return 0


@app.command
def check(file: Path, /) -> int:
    """Check a network file, its certificate and its key.

    Args:
        file: A member's network.yaml.
    """
    membership = _read(file)
    if membership.file.own.signs:
        membership.signer()
    narrate(f"{file} is valid: {membership.file.member}, {membership.file.own.role}, on {membership.file.network}")
    return 0


@app.command
def show(file: Path, /, *, json: Annotated[bool, Parameter(negative=())] = False) -> int:
    """Show what a network file permits, member by member.

    Args:
        file: A member's network.yaml.
        json: Print the access rules that Zenoh applies, as JSON.
    """
    membership = _read(file)
    own = membership.file
    if json:
        rules = msgspec.json.format(msgspec.json.encode(access_control(own.own, own.others)), indent=2)
        sys.stdout.write(f"{rules.decode()}\n")
    else:
        sys.stdout.write("\n".join(_words(membership)) + "\n")
    return 0


def _read(file: Path) -> Membership:
    """A network file; warns of a certificate that expires soon."""
    membership = read_network(file.expanduser(), utc_now())
    if warning := membership.expiry(utc_now()):
        narrate(warning, Severity.WARNING)
    return membership


def _words(membership: Membership) -> list[str]:
    own = membership.file
    lines = [f"{own.member}, {own.own.role} of the network {own.network}, certificate {own.own.certificate}"]
    lines += [f"  listens at {address}" for address in own.listen]
    lines += [f"  connects to {address}" for address in own.connect]
    if (known := membership.revocations) is not None:
        lines.append(
            f"  {known}, valid until {utc_text(known.end_s)} UTC: {counted(len(known.certificates), 'certificate')}"
        )
    for other in own.others:
        lines.append(f"{other.member}, {other.role}, certificate {other.certificate}")
        texts = {
            ("ingress", "say"): "may put here",
            ("egress", "say"): "receives",
            ("ingress", "ask"): "may query",
            ("egress", "ask"): "is queried for",
        }
        lines += [f"  {texts[grant.flow, grant.speech]}: {', '.join(grant.keys)}" for grant in grants(own.own, other)]
    if membership.rights is not None:
        stations = [other.member for other in own.others if other.role in STATIONS]
        lines += ["rights:", *_rights_lines(membership.rights, own.own.platform, stations)]
    elif own.own.role is MemberRole.PLATFORM:
        lines.append("rights: every operator may do everything; there is no rights.yaml")
    return [*lines, "child processes of this computer's user: everything; anybody else: nothing"]


def _rights_lines(file: RightsFile, platform: str, stations: Sequence[str]) -> list[str]:
    """What each station may with a platform, and what needs two persons."""
    table = Rights(platform, utc_now().timestamp, file=file, members=stations)
    lines = []
    for station in stations:
        held = ", ".join(map(str, table.held(station)))
        may = [MEANINGS[right] for right in Right if table.may(station, right)]
        lines.append(f"  {station}: {held}; looking{''.join(f', {text}' for text in may)}")
    two = [MEANINGS[right] for right in file.two_persons]
    return lines + ([f"  two persons: {', '.join(two)}"] if two else [])


def _narrate(changed: Iterable[str]) -> None:
    names = ", ".join(changed)
    if names:
        narrate(f"the files changed for {names}: copy the folder there, and send SIGHUP to the processes that use it")


def _address(text: str) -> tuple[str, int]:
    """Host and port of HOST:PORT; port 0 is any."""
    host, _, port = text.rpartition(":")
    if (problem := address_problem(text)) and port != "0":
        raise Refused(f"{problem}; write HOST:PORT, such as 192.168.1.10:7448")
    return host.strip("[]"), int(port)


def _check(days: int) -> None:
    if not 1 <= days <= MOST_DAYS:
        raise Refused(f"--days must be from 1 to {MOST_DAYS}")
