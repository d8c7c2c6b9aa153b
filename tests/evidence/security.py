"""Who reads and commands a real onboard process over real TLS links: nobody without a certificate that counts."""

import asyncio
import tempfile
from pathlib import Path

import msgspec
from tests.evidence.page import Bar, Figure, Progress
from tests.onboard.intruders import Attempt, Found, intrude

SHUT_OUT = (
    "without encryption",
    "without a certificate",
    "operator's name, other authority",
    "operator's certificate, expired",
    "operator's certificate, not yet valid",
    "operator's certificate, revoked",
    "link open when its certificate expires: after",
)
MAY_COMMAND = ("operator's certificate, good", "link open when its certificate expires: before")


def _intrude() -> Found:
    with tempfile.TemporaryDirectory() as folder:
        return asyncio.run(intrude(Path(folder)))


def _figure(one: Attempt) -> Figure:
    """One who tried."""
    value = f"read {one.messages_read} messages; of {one.sent} commands {one.carried_out} carried out"
    if one.who in SHUT_OUT:
        is_met = not (one.messages_read or one.tokens_seen or one.carried_out or one.recorded)
        return Figure(one.who, value, "reads nothing, commands nothing", is_met)
    if one.who in MAY_COMMAND:
        is_met = bool(one.messages_read and one.carried_out)
        return Figure(one.who, value, "reads and commands: the attempts are real", is_met)
    is_met = bool(one.messages_read) and not one.carried_out and not one.recorded
    return Figure(one.who, value, "reads, commands nothing", is_met)


def security(progress: Progress) -> list[Figure]:
    """All of them, at one onboard process."""
    found = msgspec.convert(progress.part("intruders", _intrude), Found)
    owner = found.owner
    is_obeyed = owner.sent == owner.carried_out == owner.recorded > 0
    legitimate = {"operator alice (network)", "operator carol (network)", "operator dave (network)"}
    return [
        *(_figure(one) for one in found.attempts),
        Figure(
            "the operator meanwhile, after each of them",
            f"of {owner.sent} commands {owner.carried_out} carried out, {owner.recorded} in the record with the author",
            "all",
            is_obeyed,
        ),
        Figure(
            "a forged name is told",
            "; ".join(found.told_of_forgeries) or "no",
            "yes",
            bool(found.told_of_forgeries),
        ),
        Figure(
            f"{found.replayed_bytes} encrypted bytes of an operator, sent again: their command is carried out",
            f"{found.replayed} time(s)",
            "once",
            found.replayed == 1,
        ),
        Figure(
            "a command that its author sends five times is carried out",
            f"{found.repeated} time(s)",
            "once",
            found.repeated == 1,
        ),
        Figure(
            "accepted commands in the record, by author",
            ", ".join(f"{author} {number}" for author, number in sorted(found.authors.items())),
            "nobody else",
            set(found.authors) == legitimate,
        ),
        Figure("`gloc3 log commands`, its last line", f"`{' '.join(found.lines[-1].split())}`"),
    ]


BARS = (
    Bar(
        "network-security",
        "Over the network, only a valid certificate with the right role reads or commands",
        "An onboard process with a simulated vehicle is on a network of `gloc3 network`, and an operator commands it. "
        "Others open links to it, with clients that do not restrain themselves. They request all topics and tokens, "
        "and try to take control and to command for 3 s: under their own name, under the operator's, and as "
        "components of the platform. Each command carries a rate of its own, by which it is recognized in the log of "
        "the vehicle. After each attempt the operator commands, which shows that missing commands were blocked, not "
        "lost.",
        security,
    ),
)
