"""The JSON of a plan file: size limits, findings with positions, and checked numbers."""

import json
from functools import cached_property
from math import isfinite
from typing import Any, Final, NoReturn, TypeGuard

from gloc3.amounts import beside
from gloc3.documents.document import Document, Where, parse
from gloc3.errors import Finding, InputError

MAX_BYTES: Final = 5_000_000
SAVE_AGAIN: Final = "open it in a current QGroundControl and save it again"


class PlanSource:
    """One file, with its findings."""

    def __init__(self, data: bytes | str, file: str) -> None:
        self._data = data
        self._file = file
        self.findings: list[Finding] = []
        self.value = self._json()

    def _json(self) -> Any:
        raw = self._data.encode("utf-8", "surrogatepass") if isinstance(self._data, str) else self._data
        if len(raw) > MAX_BYTES:
            message = f"{beside(len(raw) / 1e6, MAX_BYTES / 1e6)} MB is too large: the limit is {MAX_BYTES / 1e6:g} MB"
            raise InputError([Finding(file=self._file, message=message, hint="is this the right file?")])
        try:
            return json.loads(raw.decode("utf-8-sig"), parse_constant=_refuse_constant)
        except json.JSONDecodeError as error:
            message = f"not JSON: {error.msg.lower()}"
            finding = Finding(file=self._file, line=error.lineno, column=error.colno, message=message, hint=SAVE_AGAIN)
            raise InputError([finding]) from error
        except UnicodeDecodeError as error:
            raise InputError(
                [Finding(file=self._file, message="not UTF-8 text", hint="is this a plan file?")]
            ) from error
        except (ValueError, RecursionError) as error:
            reason = "nested too deeply" if isinstance(error, RecursionError) else str(error)
            raise InputError(
                [Finding(file=self._file, message=f"not usable JSON: {reason}", hint=SAVE_AGAIN)]
            ) from error

    def find(self, where: Where, message: str, hint: str = "") -> None:
        """Adds a finding at a path."""
        document = self._document
        if document is None:
            self.findings.append(Finding(file=self._file, message=message, hint=hint))
        else:
            self.findings.append(document.finding(where, message, hint))

    def warning(self, where: Where, message: str, hint: str) -> Finding:
        """A warning about what is at a path."""
        return Finding(file=self._file, line=self.line(where), message=message, hint=hint, is_warning=True)

    def line(self, where: Where) -> int:
        """Line of the value at a path; 0 in a file that is too large for it."""
        return self._document.node(where).line if self._document is not None else 0

    @cached_property
    def _document(self) -> Document | None:
        try:
            return parse(self._data, self._file)
        except InputError:
            return None

    def refuse(self, where: Where, message: str, hint: str) -> NoReturn:
        """Gives up.

        Raises:
            InputError: with this and all earlier findings.
        """
        self.find(where, message, hint)
        raise InputError(sorted(self.findings))

    def numbers(self, value: Any, count: int, where: Where, *, is_optional: bool = False) -> list[float]:
        """So many numbers, the first two a latitude and a longitude."""
        if value is None and is_optional:
            return []
        if not isinstance(value, list) or len(value) != count or not all(is_number(one) for one in value):
            self.find(where, f"{count} numbers are expected here")
            return []
        if abs(value[0]) > 90.0 or abs(value[1]) > 180.0:
            self.find(where, f"{value[0]:g}, {value[1]:g} is not a latitude and longitude")
            return []
        return [float(one) for one in value]


def number(holder: dict[str, Any], key: str) -> float | None:
    """A number in a mapping, if it is one."""
    value = holder.get(key)
    return float(value) if is_number(value) else None


def whole(holder: dict[str, Any], key: str) -> int | None:
    """A whole number in a mapping, if it is one."""
    value = holder.get(key)
    return value if is_whole(value, 2**31) else None


def is_number(value: Any) -> TypeGuard[float]:
    """Whether a value is a finite number."""
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) < 1e300 and isfinite(value)


def is_whole(value: Any, most: int) -> TypeGuard[int]:
    """Whether a value is a whole number from 0 to `most`."""
    return isinstance(value, int) and not isinstance(value, bool) and 0 <= value <= most


def _refuse_constant(name: str) -> float:
    raise ValueError(f"{name} is not a finite number")
