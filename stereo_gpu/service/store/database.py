"""An SQLite file that several threads use: one connection writes, another reads and never waits for the disk."""

from __future__ import annotations

import os
import sqlite3
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from stereo_gpu.errors import InputError
from stereo_gpu.service.refusals import DiskFull, StoreError
from stereo_gpu.service.store.schema import APPLICATION, TABLES, UPGRADES, VERSION

BUSY_MS = 10_000  # how long a write waits for another process, such as a command that makes a token
CACHE_KIB = 16_384


class Database:
    """The file of a `Store`.

    Every write is a transaction that has reached the disk when it returns (WAL, synchronous=FULL), and is undone
    where anything fails within it.
    """

    def __init__(self, path: str | os.PathLike[str], *, create: bool = True) -> None:
        """Open the file, and make it where it is missing and `create` is set.

        Raises:
            InputError: the file is missing, another program's, or of a newer version than this package.
            DiskFull, StoreError: it is damaged, or cannot be read or written.
        """
        self.path = Path(path)
        self._writing, self._reading = threading.Lock(), threading.Lock()
        self._closed = False
        if create:
            self._touch()
        elif not self.path.is_file():
            raise InputError(f"{self.path} is missing: name the folder of a service that has been started before")
        self._writer = self._connect()
        try:
            with _named(self.path):
                self._prepare()
            self._reader = self._connect()
        except BaseException:
            self._writer.close()
            raise

    @contextmanager
    def write(self) -> Iterator[sqlite3.Connection]:
        """A transaction that changes something: all of it or nothing, and for one thread at a time.

        Raises:
            DiskFull, StoreError: it could not be written.
        """
        with self._writing, _named(self.path):
            self._check_open()
            yield from _transaction(self._writer, "BEGIN IMMEDIATE")

    @contextmanager
    def read(self) -> Iterator[sqlite3.Connection]:
        """A transaction that sees one state of the tables, whatever is written meanwhile.

        Raises:
            StoreError: it could not be read.
        """
        with self._reading, _named(self.path):
            self._check_open()
            yield from _transaction(self._reader, "BEGIN")

    def check(self) -> list[str]:
        """What SQLite finds wrong with the file; nothing where it is whole."""
        with self.read() as tables:
            found = [_one_line(row[0]) for row in tables.execute("PRAGMA integrity_check(20)")]
            broken = [
                f"{row[0]} {row[1]} names a missing {row[2]}" for row in tables.execute("PRAGMA foreign_key_check")
            ]
        return [line for line in found if line != "ok"] + broken

    def close(self) -> None:
        """Let go of the file; the journal is folded into it. A second call does nothing."""
        with self._writing, self._reading:
            if not self._closed:
                self._closed = True
                self._reader.close()
                self._writer.close()

    def _check_open(self) -> None:
        if self._closed:
            raise StoreError(f"{self.path} is closed: the service is stopping")

    def _touch(self) -> None:
        """Make the file, readable by its owner alone; SQLite gives its journal the same mode."""
        try:
            os.close(os.open(self.path, os.O_CREAT | os.O_RDWR, 0o600))
        except OSError as error:
            raise InputError(
                f"cannot write {self.path}: {error.strerror or error}; name a folder that can be written"
            ) from error

    def _connect(self) -> sqlite3.Connection:
        with _named(self.path):
            # Transactions are begun and ended by us alone; the locks above keep threads apart.
            tables = sqlite3.connect(
                self.path, timeout=BUSY_MS / 1000, isolation_level=None, check_same_thread=False, cached_statements=256
            )
            tables.row_factory = sqlite3.Row
            for setting in ("synchronous = FULL", "foreign_keys = ON", f"cache_size = -{CACHE_KIB}"):
                tables.execute(f"PRAGMA {setting}")
            return tables

    def _prepare(self) -> None:
        """See that the tables are ours and whole, or make them in a new file."""
        tables = self._writer
        for line in tables.execute("PRAGMA quick_check(1)"):
            if line[0] != "ok":
                raise StoreError(f"{self.path} is damaged ({_one_line(line[0])}): bring it back from a backup")
        # Nothing is changed before it is known to be ours, the mode of its journal included.
        self._version()
        mode = tables.execute("PRAGMA journal_mode = WAL").fetchone()[0]
        if mode != "wal":
            raise StoreError(f"{self.path} lies on a file system without shared memory: name a folder on a local disk")
        # Another process may open the file at the same time: whoever has the lock first makes the tables.
        with self.write():
            version = self._version()
            if version == VERSION:
                return
            for script in [UPGRADES[found] for found in range(version, VERSION)] if version else [TABLES]:
                _run(tables, script)
            tables.execute(f"PRAGMA application_id = {APPLICATION}")
            tables.execute(f"PRAGMA user_version = {VERSION}")

    def _version(self) -> int:
        """Of the tables in the file; 0 where it is empty."""
        application, version = (
            int(self._writer.execute(f"PRAGMA {name}").fetchone()[0]) for name in ("application_id", "user_version")
        )
        (things,) = self._writer.execute("SELECT count(*) FROM sqlite_master").fetchone()
        if not things:
            return 0
        if application != APPLICATION:
            raise InputError(f"{self.path} is a database of another program: name another folder")
        if version > VERSION:
            raise InputError(
                f"{self.path} has tables of version {version}, this package knows {VERSION}: install the newer one"
            )
        return version


def _one_line(found: str) -> str:
    """SQLite tells which of its databases it is about on a line of its own; there is only one."""
    return found.removeprefix("*** in database main ***").strip().replace("\n", "; ")


def _run(tables: sqlite3.Connection, script: str) -> None:
    """Each statement of a script; `executescript` would end the transaction."""
    statement = ""
    for line in script.splitlines(keepends=True):
        statement += line
        if sqlite3.complete_statement(statement):
            tables.execute(statement)
            statement = ""


def _transaction(tables: sqlite3.Connection, begin: str) -> Iterator[sqlite3.Connection]:
    tables.execute(begin)
    try:
        yield tables
        tables.execute("COMMIT")
    except BaseException:
        if tables.in_transaction:
            with suppress(sqlite3.Error):  # the first error tells
                tables.execute("ROLLBACK")
        raise


@contextmanager
def _named(path: Path) -> Iterator[None]:
    """Turn SQLite's errors into lines that name the file and the way out."""
    try:
        yield
    except sqlite3.Error as error:
        # The lowest eight bits are the kind, the rest of them says where.
        code = getattr(error, "sqlite_errorcode", 0) & 0xFF
        if code == sqlite3.SQLITE_FULL:
            raise DiskFull(f"cannot write {path}: the disk is full; make room") from error
        if code in (sqlite3.SQLITE_CORRUPT, sqlite3.SQLITE_NOTADB):
            raise StoreError(f"{path} is damaged or no database ({error}): bring it back from a backup") from error
        if code == sqlite3.SQLITE_BUSY:
            raise StoreError(f"{path} is held by another process ({error}): end it") from error
        raise StoreError(f"cannot use {path}: {error}; see that its folder can be written and has room") from error
