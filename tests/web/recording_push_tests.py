"""Push tests that never push."""

from web.push_test import PushTestStatus


class RecordingPushTests:
    """Keeps what it was asked, and answers `now`."""

    def __init__(self) -> None:
        self.calls: list[tuple[str, float, int] | None] = []
        self.now = PushTestStatus()

    def start(self, mode: str, force_n: float, directions: int) -> None:
        self.calls.append((mode, force_n, directions))

    def cancel(self) -> None:
        self.calls.append(None)

    def status(self) -> PushTestStatus:
        return self.now
