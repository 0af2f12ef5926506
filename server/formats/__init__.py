"""Foreign formats, one file each: bytes on disk to typed messages or arrays in SI units, and back."""

from server.formats.errors import FormatError
from server.formats.logs import Log, read_log

__all__ = ["FormatError", "Log", "read_log"]
