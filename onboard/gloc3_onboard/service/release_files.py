"""Verification of a release's files by its checksums, and of these by their signature (docs/install.md)."""

import hashlib
import subprocess
from pathlib import Path
from typing import Final

from gloc3.errors import Refused

CHECKSUMS: Final = "SHA256SUMS"
IDENTITY: Final = "release@gloc3"
"""Of the signer, in a file of allowed signers."""
NAMESPACE: Final = "gloc3-release"
"""Of the signature (ssh-keygen(1), `-Y sign`)."""
SIGNERS: Final = "allowed_signers"
"""File of the public keys of those whose releases are installed (ssh-keygen(1)), in the folder of the versions."""


def verify(file: Path, signers: Path | None) -> str:
    """Verifies a file of a release against `SHA256SUMS` beside it.

    Args:
        file: the file.
        signers: public keys, one of which must have signed the checksums; None accepts unsigned ones, or none at all.

    Returns:
        What was verified, in a sentence.

    Raises:
        Refused: it is not the released file, or the signature does not hold; or there are signers and no signature.
    """
    sums = file.parent / CHECKSUMS
    if signers is None and not sums.is_file():
        return f"{file.name} is not verified: there is no {CHECKSUMS} beside it"
    checksums = _read(sums)
    if signers is not None:
        _verify_signature(checksums, sums, signers)
    lines = (line.split(maxsplit=1) for line in checksums.decode("utf-8", "replace").splitlines())
    of = {line[1].removeprefix("*"): line[0] for line in lines if len(line) == 2}  # sum and name
    if file.name not in of:
        raise Refused(f"{sums} has no line for {file.name}")
    with file.open("rb") as content:
        found = hashlib.file_digest(content, "sha256").hexdigest()
    if found != of[file.name]:
        raise Refused(f"{file} is not the released file: its SHA-256 is {found}, that in {sums} {of[file.name]}")
    by = "whose signature is not verified: no keys are set" if signers is None else f"signed by {IDENTITY} of {signers}"
    return f"{file.name} is as in {CHECKSUMS} ({by})"


def _verify_signature(checksums: bytes, sums: Path, signers: Path) -> None:
    signature = sums.with_name(f"{sums.name}.sig")
    _read(signature)
    _read(signers)
    verify = ["ssh-keygen", "-Y", "verify", "-f", str(signers), "-I", IDENTITY, "-n", NAMESPACE, "-s", str(signature)]
    try:
        done = subprocess.run(verify, input=checksums, capture_output=True, check=False)
    except OSError as error:
        raise Refused(f"ssh-keygen: {error.strerror or error}; it is in the package openssh-client") from error
    if done.returncode != 0:
        reason = (done.stderr or done.stdout).decode("utf-8", "replace").strip()
        raise Refused(f"{signature} does not hold for {sums} and the keys in {signers}: {reason}")


def _read(file: Path) -> bytes:
    try:
        return file.read_bytes()
    except OSError as error:
        raise Refused(f"{file}: {error.strerror}; it is needed to verify the release") from error
