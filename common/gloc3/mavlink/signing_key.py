"""A MAVLink signing key in a file that only its owner can read."""

from __future__ import annotations

import re
import stat
from hashlib import sha256
from pathlib import Path
from typing import Final

from gloc3.errors import Finding, InputError
from gloc3.mavlink.signing import KEY_BYTES

MAX_BYTES: Final = 4096
PASSPHRASE: Final = "passphrase:"
LEAST_CHARACTERS: Final = 8
_FORMS: Final = (
    "write 64 hexadecimal digits (`openssl rand -hex 32`), or `passphrase: ...` as MAVProxy and QGroundControl take"
)


def read_signing_key(path: Path) -> bytes:
    """Reads a key: 32 bytes, 64 hexadecimal digits, or `passphrase: words`, whose SHA-256 is the key.

    Raises:
        InputError: it contains no key, or users other than its owner can read it.
    """
    try:
        with path.open("rb") as file:
            mode = path.stat().st_mode
            if not stat.S_ISREG(mode):
                raise _refused(path, "not a file")
            if mode & 0o077:
                message = f"other users can access this key (mode {stat.S_IMODE(mode):04o})"
                raise _refused(path, message, f"chmod 600 {path}; if it may have been read, make another key")
            data = file.read(MAX_BYTES + 1)
    except OSError as error:
        raise _refused(path, f"cannot be read: {error.strerror or error}") from error
    if len(data) == KEY_BYTES:
        return data
    try:
        text = data.decode().strip()
    except UnicodeDecodeError:
        text = ""
    if len(data) <= MAX_BYTES and text.startswith(PASSPHRASE):
        words = text.removeprefix(PASSPHRASE).strip()
        if len(words) < LEAST_CHARACTERS:
            raise _refused(path, f"a passphrase has at least {LEAST_CHARACTERS} characters")
        return sha256(words.encode()).digest()
    if re.fullmatch(r"[0-9a-fA-F]{64}", text) is None:
        raise _refused(path, "not a signing key", _FORMS)
    return bytes.fromhex(text)


def _refused(path: Path, message: str, hint: str = "") -> InputError:
    return InputError([Finding(file=str(path), message=message, hint=hint)])
