"""Signing keys in files: three forms, and nobody else may read them."""

from hashlib import sha256
from pathlib import Path

import pytest

from gloc3.errors import InputError
from gloc3.mavlink.signing_key import read_signing_key

KEY = bytes(range(32))


def written(path: Path, data: bytes, mode: int = 0o600) -> Path:
    path.write_bytes(data)
    path.chmod(mode)
    return path


@pytest.mark.parametrize(
    ("data", "key"),
    [
        (KEY, KEY),
        (KEY.hex().encode() + b"\n", KEY),
        (b"passphrase: correct horse\n", sha256(b"correct horse").digest()),
    ],
)
def test_a_key_is_read_in_each_form(tmp_path: Path, data: bytes, key: bytes) -> None:
    assert read_signing_key(written(tmp_path / "key", data)) == key


@pytest.mark.parametrize("mode", [0o644, 0o640, 0o604, 0o620])
def test_a_key_that_others_may_use_is_refused_with_what_to_do(tmp_path: Path, mode: int) -> None:
    path = written(tmp_path / "key", KEY, mode)
    with pytest.raises(InputError, match=f"other users can access this key .mode {mode:04o}.*chmod 600 {path}"):
        read_signing_key(path)


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (b"", "not a signing key"),
        (b"ab" * 31, "not a signing key"),
        (b"passphrase: ab", "at least 8"),
        (b"\xff" * 40, "no"),
    ],
)
def test_what_is_no_key_is_refused(tmp_path: Path, data: bytes, words: str) -> None:
    with pytest.raises(InputError, match=words):
        read_signing_key(written(tmp_path / "key", data))


def test_a_file_that_is_not_there_and_a_folder_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="cannot be read: No such file"):
        read_signing_key(tmp_path / "none")
    with pytest.raises(InputError, match="Is a directory"):
        read_signing_key(tmp_path)
