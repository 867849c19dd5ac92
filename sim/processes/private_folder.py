"""A folder of one user alone, below one in which everybody may write, opened without following what others have put there."""

import contextlib
import os
import stat
from pathlib import Path


class UnsafeFolderError(PermissionError):
    """Others own the folder, or may write into it; the message names it and the cure."""


def open_private_folder(path: Path) -> int:
    """Descriptor of the folder, to open files relative to it; made, for its user alone, where there is none.

    Raises:
        UnsafeFolderError: it is a link or a file, another user's, or open to others.
        OSError: it cannot be made.
    """
    with contextlib.suppress(FileExistsError):
        path.mkdir(0o700)
    try:
        descriptor = os.open(path, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW)
    except (NotADirectoryError, PermissionError) as error:
        raise UnsafeFolderError(f"{path} is no folder of this user ({error.strerror}); remove it") from None
    status = os.fstat(descriptor)
    if status.st_uid != os.geteuid() or status.st_mode & (stat.S_IRWXG | stat.S_IRWXO):
        os.close(descriptor)
        raise UnsafeFolderError(f"{path} belongs to user {status.st_uid} or is open to others; remove it")
    return descriptor
