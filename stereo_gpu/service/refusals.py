"""What the service answers where a request is in order and yet cannot be met; each is one line.

NotFound      no such job, rig or file, or another client's
Conflict      the thing is not in a state for this
`-- Busy      it is still needed
QueueFull     too many jobs wait
KeyReused     an Idempotency-Key that belongs to another request
StoreError    the table or the folder of the service cannot be read or written
`-- DiskFull  there is no room
"""

from __future__ import annotations

from stereo_gpu.errors import InputError, StereoError


class NotFound(StereoError):
    """There is no such thing, or it is another client's, which is all the same to who asks."""


class Conflict(StereoError):
    """The thing is not in a state for what is asked."""


class Busy(Conflict):
    """The thing is still needed by a job."""


class QueueFull(StereoError):
    """Too many jobs wait, of all clients or of this one.

    Args:
        message: the one line.
        retry_s: whole seconds after which there should be room, by the rate of the last minute.
    """

    def __init__(self, message: str, retry_s: int) -> None:
        super().__init__(message)
        self.retry_s = retry_s


class KeyReused(InputError):
    """An Idempotency-Key came again with another request."""


class StoreError(StereoError):
    """The table or the folder of the service cannot be read or written."""


class DiskFull(StoreError):
    """There is no room on the disk."""


def no_rig(id: str) -> InputError:
    """What is said of a job or an outline that names a rig which its client does not have."""
    return InputError(f"there is no rig {id!r:.50}: ask for the list of rigs, or send it again")
