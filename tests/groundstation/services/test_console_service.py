"""The console: output that steers no terminal, lines that are answered, and refusals where there is no shell."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gloc3.documents.characters import first_steering
from gloc3.errors import Refused
from gloc3.mavlink.services.heartbeat import ARMED
from gloc3.mavlink.shell import SHELL
from gloc3_groundstation.services.console import MOST_LINES, WIDEST, ConsoleText

from .scripted_vehicle import ARDUPILOT, STATION, Scene, over


def shown(*pieces: bytes) -> list[str]:
    text = ConsoleText()
    for piece in pieces:
        text.feed(piece)
    return list(text.lines)


@pytest.mark.parametrize(
    ("data", "lines"),
    [
        (b"nsh> \x1b[K", ["nsh> "]),
        (b"a\r\nb\n", ["a", "b", ""]),
        (b"12345\rab", ["ab345"]),
        (b"12345\r\x1b[K6", ["6"]),
        (b"ab\bc", ["ac"]),
        (b"a\tb", ["a       b"]),
        (b"\x1b[31mred\x1b[0m", ["red"]),
        (b"\x1b]0;title\x07x\x1b]2;y\x1b\\z", ["xz"]),
        (b"\x07\x9b\x1b\x1bZ", ["\ufffd" * 3 + "\ufffdZ"]),
        ("\u202egpj\u2066".encode(), ["\ufffdgpj\ufffd"]),
        (b"\xff\xfe", ["\ufffd\ufffd"]),
    ],
)
def test_output_is_shown_without_what_steers_a_terminal(data: bytes, lines: list[str]) -> None:
    assert shown(data) == lines
    assert shown(*(data[i : i + 1] for i in range(len(data)))) == lines, "whatever the pieces"


@given(
    st.lists(st.binary(max_size=40) | st.sampled_from([b"\x1b[", b"\x1b]", b"\x07", b"\r", b"\b", b"\n"]), max_size=20)
)
def test_no_bytes_whatever_steer_the_terminal(pieces: list[bytes]) -> None:
    for line in shown(*pieces):
        assert first_steering(line) == ""


def test_output_is_bounded() -> None:
    text = ConsoleText()
    text.feed(b"x\n" * (MOST_LINES + 5))
    assert (len(text.lines), text.first) == (MOST_LINES + 1, 5)
    text.feed(b"y" * (3 * WIDEST))
    assert max(map(len, text.lines)) == WIDEST
    text.feed(b"\x1b]" + b"z" * 5000)
    assert len("".join(text.lines)) > 5000, "a sequence without an end is shown as text"


def answering(scene: Scene, *lines: bytes) -> None:
    """Has the vehicle answer whatever is typed with the next of some lines."""
    waiting, seen = list(lines), [0]

    def poll() -> None:
        typed = [one.decode() for one in scene.vehicle.received[seen[0] :]]
        seen[0] = len(scene.vehicle.received)
        if waiting and any(one is not None and one.name == "SERIAL_CONTROL" for one in typed):
            data = waiting.pop(0)
            fields = {"flags": 1, "timeout": 0, "baudrate": 0, "target_system": STATION.system}
            scene.vehicle.send(
                "SERIAL_CONTROL", device=SHELL, count=len(data), data=tuple(data.ljust(70, b"\0")), **fields
            )
        scene.services.machines.loop.call_later(0.1, poll)

    poll()


def test_a_line_is_typed_and_answered() -> None:
    async def play(scene: Scene) -> None:
        answering(scene, b"\nnsh> \x1b[K", b"free\nnsh> ", b"a pause without a prompt")
        console = scene.services.console
        await console.run("free")
        assert console.text.lines[-2:] == ("nsh> free", "nsh> ")
        await console.run("slow")
        assert console.text.current == "nsh> a pause without a prompt"
        assert console.is_open
        with pytest.raises(Refused, match="nothing came back for 2 s; the line may be lost"):
            await console.run("lost")
        assert not console.is_open

    over(play)


def test_a_vehicle_without_a_shell_is_refused() -> None:
    async def play(scene: Scene) -> None:
        with pytest.raises(Refused, match=r"does not answer on its shell \(3 attempts of 2 s\)"):
            await scene.services.console.run("ver all")
        sent = [one for frame in scene.vehicle.received if (one := frame.decode()) is not None]
        typed = [one for one in sent if one.name == "SERIAL_CONTROL"]
        assert {bytes(one.data[: one.count]) for one in typed} == {b"\n"}, "the line itself was not typed"

    over(play)


def test_ardupilot_and_armed_vehicles_are_refused() -> None:
    async def ardupilot(scene: Scene) -> None:
        with pytest.raises(Refused, match="ArduPilot has no shell"):
            await scene.services.console.open()

    over(ardupilot, autopilot=ARDUPILOT)

    async def armed(scene: Scene) -> None:
        answering(scene, b"nsh> ")
        scene.vehicle.heartbeat.base_mode |= ARMED
        await scene.pass_s(2.0)
        with pytest.raises(Refused, match="armed; nothing was typed"):
            await scene.services.console.open()
        await scene.services.console.open(while_armed=True)

    over(armed)


def test_a_line_with_control_characters_is_refused() -> None:
    async def play(scene: Scene) -> None:
        for line in ("a\nb", "a\x1b[A", "x" * 300):
            with pytest.raises(Refused, match="no control characters"):
                await scene.services.console.run(line)

    over(play)
