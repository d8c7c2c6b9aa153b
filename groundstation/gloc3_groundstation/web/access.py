"""Who may open the station's pages: tokens in addresses, the cookies that replace them, and the rights they give."""

import hmac
import stat
from enum import StrEnum
from hashlib import sha256
from pathlib import Path
from secrets import token_urlsafe
from typing import Final

from gloc3.errors import Refused
from gloc3.store import write_secret

TOKEN_BYTES: Final = 16
LEAST_CHARACTERS: Final = 16
MOST_CHARACTERS: Final = 128
REPORTED_S: Final = 60.0
"""Period of reports about wrong tokens, s."""


class WebRight(StrEnum):
    """What a browser may do."""

    COMMAND = "command"
    WATCH = "watch"
    """Look; keys and HOLD do nothing."""


class Access:
    """Tells browsers with a right from those without.

    The token for watching is derived from the one for commanding, and cookies are derived from tokens; no one of them
    leads back. Everything is compared in constant time.

    Args:
        token: opens the station for commands; empty where none is needed.
        is_read_only: whether nobody may command.
    """

    def __init__(self, token: str, *, is_read_only: bool = False) -> None:
        self.is_read_only: Final = is_read_only
        self.tokens: Final = {} if not token else {WebRight.WATCH: _derived(token, "watch")}
        """The tokens that open the station, by the right that they give; empty where none is needed."""
        if token and not is_read_only:
            self.tokens[WebRight.COMMAND] = token
        self._cookies = {right: _derived(token, "cookie") for right, token in self.tokens.items()}
        self.wrong = 0
        """Requests with a wrong token or cookie."""
        self._reported = 0
        self._reported_s = float("-inf")

    def by_token(self, token: str) -> WebRight | None:
        """The right that a token gives."""
        return _found(self.tokens, token)

    def by_cookie(self, cookie: str | None) -> WebRight | None:
        """The right of a browser: by its cookie, or that of every browser where no token is needed."""
        if not self.tokens:
            return WebRight.WATCH if self.is_read_only else WebRight.COMMAND
        return None if cookie is None else _found(self._cookies, cookie)

    def cookie(self, right: WebRight) -> str:
        """The cookie that replaces a token in the address."""
        return self._cookies[right]

    def refuse(self, who: str, now_s: float) -> str:
        """Counts a request with a wrong token.

        Returns:
            Text to report; empty where it was reported already in the last minute.
        """
        self.wrong += 1
        if now_s - self._reported_s < REPORTED_S:
            return ""
        more = self.wrong - self._reported - 1
        self._reported, self._reported_s = self.wrong, now_s
        others = f", and {more} more before it" if more else ""
        return f"the page was refused to {who}: wrong token{others} ({self.wrong} in all)"


def new_token() -> str:
    """A token that nobody can guess."""
    return token_urlsafe(TOKEN_BYTES)


def read_token(path: Path) -> str:
    """Reads the token in a file that only its owner can access; writes a new one where there is no file.

    Raises:
        Refused: it cannot be read or written, other users can access it, or it holds no token.
    """
    try:
        if not path.exists():
            write_secret(path, f"{new_token()}\n".encode())
        mode = path.stat().st_mode
        if stat.S_ISREG(mode) and mode & 0o077:
            raise Refused(
                f"--web-token: other users can access {path} (mode {stat.S_IMODE(mode):04o}): chmod 600 {path}"
            )
        with path.open("rb") as file:
            token = file.read(MOST_CHARACTERS + 2).decode("ascii").strip()
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) and error.strerror else "not a token"
        raise Refused(f"--web-token: {path}: {reason}") from error
    is_plain = token.replace("-", "").replace("_", "").isalnum()
    if not (is_plain and LEAST_CHARACTERS <= len(token) <= MOST_CHARACTERS):
        raise Refused(
            f"--web-token: {path} holds no token: {LEAST_CHARACTERS} to {MOST_CHARACTERS} letters, digits, - and _ are "
            "expected; delete it to have one made"
        )
    return token


def _derived(token: str, what: str) -> str:
    return hmac.new(token.encode(), what.encode(), sha256).hexdigest()[:32]


def _found(known: dict[WebRight, str], given: str) -> WebRight | None:
    """The right whose secret is given; all are compared, so that the time shows nothing."""
    data = given.encode("utf-8", "replace")
    found = [right for right, secret in known.items() if hmac.compare_digest(secret.encode(), data)]
    return found[0] if found else None
