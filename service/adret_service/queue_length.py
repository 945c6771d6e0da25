"""How many jobs wait, counted now and then: the limit on them need not be met to the job."""

import time
from collections.abc import Callable

__all__ = ["QueueLength"]

FRESH = 0.1  # seconds


class QueueLength:
    """The number of jobs that wait, with those that this process has accepted since it looked.

    Orders of other processes are seen a tenth of a second later, so a queue may grow longer than
    its limit by as many as they accept in that time.

    Parameters
    ----------
    count : callable
        Counts them in the database.
    clock : callable
        Seconds that never go back.

    Examples
    --------
    >>> length = QueueLength(lambda: 7, clock=lambda: 0.0)
    >>> length.now(), length.one_more(), length.now()
    (7, None, 8)
    """

    def __init__(
        self, count: Callable[[], int], clock: Callable[[], float] = time.monotonic
    ) -> None:
        self._count = count
        self._clock = clock
        self._looked: float | None = None
        self._known = 0

    def now(self) -> int:
        """Return the number, at most a tenth of a second old."""
        now = self._clock()
        if self._looked is None or now - self._looked > FRESH:
            self._known = self._count()
            self._looked = now
        return self._known

    def one_more(self) -> None:
        """Note that an order was accepted."""
        self._known += 1
