"""The rigs of the clients."""

from __future__ import annotations

from stereo_gpu.service.records import RigRecord
from stereo_gpu.service.refusals import Busy
from stereo_gpu.service.store.part import Part, insert_rig, rig_of


class Rigs(Part):
    """Rigs: the table; their files are in the folder."""

    def add_rig(self, rig: RigRecord) -> RigRecord:
        """Remember a rig whose file is there; returns it with its place in the table."""
        with self._database.write() as tables:
            insert_rig(tables, rig)
            return rig_of(tables.execute("SELECT * FROM rigs WHERE id = ?", (rig.id,)).fetchone())

    def rig(self, client: str, id: str) -> RigRecord | None:
        """A client's rig; None where it has none of this id."""
        with self._database.read() as tables:
            row = tables.execute("SELECT * FROM rigs WHERE id = ? AND client = ?", (id, client)).fetchone()
        return None if row is None else rig_of(row)

    def rigs(self, client: str, *, limit: int = 50, after: int | None = None) -> list[RigRecord]:
        """A client's rigs, newest first: up to `limit` of those whose `order` is smaller than `after`."""
        bound = "" if after is None else " AND number < :after"
        with self._database.read() as tables:
            rows = tables.execute(
                f"SELECT * FROM rigs WHERE client = :client{bound} ORDER BY number DESC LIMIT :limit",
                {"client": client, "after": after, "limit": limit},
            ).fetchall()
        return [rig_of(row) for row in rows]

    def every_rig(self) -> list[RigRecord]:
        """The rigs of all clients, oldest first."""
        with self._database.read() as tables:
            return [rig_of(row) for row in tables.execute("SELECT * FROM rigs ORDER BY number")]

    def delete_rig(self, client: str, id: str) -> bool:
        """Forget a rig; whether there was one. Jobs that have ended keep its id.

        Raises:
            Busy: jobs that have not ended need it.
        """
        with self._database.write() as tables:
            if tables.execute("SELECT 1 FROM rigs WHERE id = ? AND client = ?", (id, client)).fetchone() is None:
                return False
            query = "SELECT count(*) FROM jobs WHERE rig = ? AND ended IS NULL"
            (needed,) = tables.execute(query, (id,)).fetchone()
            if needed:
                raise Busy(f"rig {id} is needed by {needed} jobs that have not ended: cancel them, or wait")
            tables.execute("DELETE FROM rigs WHERE id = ?", (id,))
            return True
