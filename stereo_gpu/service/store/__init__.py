"""All that the service remembers: clients, rigs and jobs, in one SQLite file."""

from stereo_gpu.service.refusals import Busy, Conflict, DiskFull, KeyReused, NotFound, QueueFull, StoreError
from stereo_gpu.service.store.leases import Ending
from stereo_gpu.service.store.store import Store

__all__ = ["Busy", "Conflict", "DiskFull", "Ending", "KeyReused", "NotFound", "QueueFull", "Store", "StoreError"]
