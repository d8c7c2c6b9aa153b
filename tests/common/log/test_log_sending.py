"""Logs that are sent elsewhere by real commands: each once, when it is complete, again where it failed."""

import os
import time
from pathlib import Path

import pytest

from gloc3.cli.program import run
from gloc3.errors import Refused
from gloc3.log.sending import ABANDONED_S, send_logs

from .samples import small_log

DONE, RUNNING = (small_log(is_closed=is_closed)[0] for is_closed in (True, False))


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Two logs, the later one still written, and a place to send them to."""
    made = tmp_path / "logs"
    made.mkdir()
    (tmp_path / "there").mkdir()
    (made / "log.mcap").write_bytes(DONE)
    (made / "log.tlog").write_bytes(b"frames")
    (made / "log-2.mcap").write_bytes(RUNNING)
    (made / "notes.txt").write_text("no log")
    return made


def there(folder: Path) -> list[str]:
    return sorted(path.name for path in (folder.parent / "there").iterdir())


def test_each_log_is_sent_once_when_it_is_complete(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    def send() -> str:
        assert run(["log", "send", str(folder), "--by", f"cp {{}} {folder.parent}/there/"]) == 0
        return capsys.readouterr().err

    told = send()
    assert told.splitlines()[-3:] == ["log.mcap was sent", "log.tlog was sent", "log-2.mcap is still written"]
    assert there(folder) == ["log.mcap", "log.tlog"]
    assert (folder.parent / "there/log.mcap").read_bytes() == DONE
    for path in (folder.parent / "there").iterdir():
        path.unlink()
    send()
    assert there(folder) == []
    (folder / "log-2.mcap").write_bytes(DONE)
    send()
    assert there(folder) == ["log-2.mcap"]


def test_a_log_that_its_process_left_unfinished_is_sent_after_a_while(folder: Path) -> None:
    long_ago = time.time() - ABANDONED_S - 1.0
    os.utime(folder / "log-2.mcap", (long_ago, long_ago))
    found = send_logs(folder, f"cp -t {folder.parent}/there", lambda _: None)
    assert found == (("log-2.mcap", "log.mcap", "log.tlog"), (), ())


def test_what_fails_is_told_and_tried_again(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    at = folder.parent / "later"
    command = f"cp {{}} {at}/"
    assert run(["log", "send", str(folder), "--by", command]) == 1
    assert "log.mcap was not sent: cp ended with 1: cp: cannot create regular file" in capsys.readouterr().err
    assert not (folder / "sent.txt").exists()
    at.mkdir()
    assert run(["log", "send", str(folder), "--by", command]) == 0
    assert sorted(path.name for path in at.iterdir()) == ["log.mcap", "log.tlog"]
    told = list[str]()
    (folder / "sent.txt").unlink()
    send_logs(folder, "no-such-program {}", told.append)
    assert told[0] == "log.mcap was not sent: no-such-program: No such file or directory"


def test_names_and_texts_in_another_encoding_do_not_end_the_sending(folder: Path) -> None:
    sent = folder / "sent.txt"
    sent.write_bytes(b"f\xfchrung.mcap\t9\n")
    told = list[str]()
    assert send_logs(folder, "sh -c 'printf \"gr\\374n\" >&2; exit 3' {}", told.append).sent == ()
    assert told[0] == "log.mcap was not sent: sh ended with 3: gr\ufffdn"
    assert send_logs(folder, f"cp -t {folder.parent}/there", told.append)[0] == ("log.mcap", "log.tlog")
    assert sent.read_bytes().startswith(b"f\xfchrung.mcap\t9\n")


@pytest.mark.parametrize(
    ("command", "message"), [("", "the command is empty"), ("cp 'a", "is no command: No closing quotation")]
)
def test_what_is_no_command_is_refused(folder: Path, command: str, message: str) -> None:
    with pytest.raises(Refused, match=message):
        send_logs(folder, command, lambda _: None)


def test_a_folder_that_is_not_there_is_refused(tmp_path: Path) -> None:
    with pytest.raises(Refused, match="nowhere cannot be read: No such file or directory"):
        send_logs(tmp_path / "nowhere", "cp {} .", lambda _: None)
