"""Who may use the service: a client is known by its tokens, of which only hashes are kept."""

from __future__ import annotations

import hashlib
import hmac
import re
import secrets
from collections.abc import Callable

from stereo_gpu.errors import InputError
from stereo_gpu.service.store.part import Part

TOKEN_BYTES = 32
LONGEST_TOKEN = 256  # characters; anything longer is none of ours and is not even hashed
_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]{0,63}")


class Clients(Part):
    """Tokens and the clients that they stand for."""

    def add_client(self, name: str, *, keep: Callable[[str], object] | None = None) -> str:
        """A new token, of 256 random bits, for the client of this name; it may have others already.

        It cannot be asked for again: only its sha256 is kept, which suffices for what cannot be guessed.

        Args:
            name: of the client.
            keep: told the token before it counts, so that none counts that nobody knows: if it fails, there is none.

        Raises:
            InputError: the name is not one of up to 64 letters, digits, dots, dashes and underscores.
        """
        if not _NAME.fullmatch(name):
            raise InputError(f"client {name!r:.80}: use up to 64 letters, digits, dots, dashes and underscores")
        token, now = secrets.token_urlsafe(TOKEN_BYTES), self._clock()
        with self._database.write() as tables:
            tables.execute("INSERT INTO clients (name, created) VALUES (?, ?) ON CONFLICT DO NOTHING", (name, now))
            tables.execute("INSERT INTO tokens VALUES (?, ?, ?)", (_hash(token), name, now))
            if keep is not None:
                keep(token)
        return token

    def client_of(self, token: str) -> str | None:
        """Whose token this is; None where it is nobody's.

        All of them are compared, each in a time that does not depend on where it differs.
        """
        if len(token) > LONGEST_TOKEN:
            return None
        wanted, found = _hash(token), None
        with self._database.read() as tables:
            rows = tables.execute("SELECT sha256, client FROM tokens").fetchall()
        for sha256, client in rows:
            if hmac.compare_digest(sha256, wanted):
                found = client
        return found

    def clients(self) -> list[str]:
        """The names of those that have a token."""
        with self._database.read() as tables:
            return [row[0] for row in tables.execute("SELECT DISTINCT client FROM tokens ORDER BY client")]

    def remove_client(self, name: str) -> bool:
        """Make all tokens of a client void; whether it had any.

        Its jobs go on, and are kept as long as others.
        """
        with self._database.write() as tables:
            return tables.execute("DELETE FROM tokens WHERE client = ?", (name,)).rowcount > 0


def _hash(token: str) -> bytes:
    return hashlib.sha256(token.encode("utf-8", "surrogateescape")).digest()
