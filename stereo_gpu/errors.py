"""What this library raises, so that a caller can catch all of it or one kind.

StereoError
|-- InputError        a file, picture, rig or option is wrong (command line: exit status 2)
|   `-- PictureError  a picture cannot be read or does not fit the others
|-- CalibrationError  the board pictures do not give a calibration
|-- CameraError       a camera or stream that was read fails and does not come back
|-- BackendError      a device is missing, cannot be used or failed
|   `-- MemoryLimitError  a job does not fit the device
|-- StageError        a stage had nothing to work on (no valid disparity, an empty mesh)
|-- WorkerError       a process that did a job died or was stopped at a limit: the job may go well another time
`-- CancelledError    somebody wanted a job no more

Every message is one line: the thing, the value, the way out.
"""


class StereoError(Exception):
    """Base of every error that stereo_gpu raises on purpose."""


class InputError(StereoError):
    """A file, a picture, a rig or an option is wrong; the caller can mend it."""


class PictureError(InputError):
    """A picture is missing, unreadable or does not fit the others."""


class CalibrationError(InputError):
    """The board pictures do not give a calibration."""


class CameraError(StereoError):
    """A camera or stream that was read fails and does not come back."""


class BackendError(StereoError):
    """A device is missing, cannot be used or failed."""


class MemoryLimitError(BackendError):
    """A job needs more memory than the device has."""


class StageError(StereoError):
    """A stage had nothing to work on."""


class WorkerError(StereoError):
    """A process that did a job died, or was stopped at a limit of time or memory; the job may go well another time."""


class CancelledError(StereoError):
    """Somebody wanted a job no more."""
