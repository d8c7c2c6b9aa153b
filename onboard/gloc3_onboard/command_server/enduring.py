"""Records on a disk that may be full or broken: what cannot be kept is told, and the flight goes on without it."""

from gloc3_onboard.records import Records


class EnduringStore:
    """A store that never raises: a vehicle in the air must stay under command when its disk is full.

    What could not be kept is owed to the disk; until it is there a restart would know an older state.

    Args:
        store: the file.
        what: is kept there, in words: *progress*.
    """

    def __init__(self, store: Records, what: str) -> None:
        self._store, self._what = store, what
        self.problem = ""
        """Why the last was not kept or read; empty where it was."""
        self._is_failing = False
        """The last attempt to keep something has failed."""
        self._whole: list[bytes] | None = None
        """All records anew, where these are owed; before `_owed`."""
        self._owed: list[bytes] = []

    def load(self) -> list[bytes]:
        """All whole records, oldest first; none where they cannot be read."""
        try:
            return self._store.load()
        except OSError as error:
            self.problem = f"the kept {self._what} cannot be read: {error.strerror or error}"
            return []

    def append(self, record: bytes) -> None:
        """Adds a record."""
        self._owed.append(record)
        self._settle()

    def rewrite(self, records: list[bytes]) -> None:
        """Replaces all records at once."""
        self._whole, self._owed = records, []
        self._settle()

    def mark(self) -> int:
        """A number for all that was written so far."""
        return self._store.mark()

    def wait(self, mark: int, most_s: float) -> bool:
        """Whether nothing of that is on its way to the disk any more, after a wait of at most so long."""
        return self._store.wait(mark, most_s)

    def try_again(self) -> None:
        """Looks whether the disk has taken everything, and writes what is owed, if something is."""
        try:
            self._store.check()
        except OSError as error:
            self._fail(error)
        else:
            if self._is_failing:
                self._settle()

    def _settle(self) -> None:
        try:
            if self._whole is not None:
                self._store.rewrite(self._whole)
                self._whole = None
            while self._owed:
                self._store.append(self._owed[0])
                del self._owed[0]
        except OSError as error:
            self._fail(error)
        else:
            self._is_failing, self.problem = False, ""

    def _fail(self, error: OSError) -> None:
        self._is_failing = True
        self.problem = f"the {self._what} cannot be kept: {error.strerror or error}"
