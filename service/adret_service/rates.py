"""How often one credential may ask: a bucket of requests that fills up again."""

import re
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass

__all__ = ["Buckets", "Rate"]

_RATE = re.compile(r"([1-9][0-9]{0,8})/([smh])")
SECONDS = {"s": 1.0, "m": 60.0, "h": 3600.0}
PRUNE = 10_000  # buckets above which full ones are forgotten


@dataclass(frozen=True, slots=True)
class Rate:
    """`count` requests in `seconds`; so many may also come at once.

    Examples
    --------
    >>> Rate.parse("600/m")
    Rate(count=600, seconds=60.0)
    """

    count: int
    seconds: float

    @classmethod
    def parse(cls, text: str) -> "Rate":
        """Read "600/m": a number a second, minute or hour."""
        found = _RATE.fullmatch(text)
        if found is None:
            raise ValueError(f"must be like 600/m (or /s, /h), got {text!r}")
        return cls(int(found[1]), SECONDS[found[2]])


class Buckets:
    """One bucket for each name; it holds `rate.count` requests and fills in `rate.seconds`.

    Parameters
    ----------
    rate : Rate
    clock : callable
        Seconds that never go back.
    """

    def __init__(self, rate: Rate, clock: Callable[[], float] = time.monotonic) -> None:
        self.rate = rate
        self._clock = clock
        self._lock = threading.Lock()
        self._levels: dict[str, tuple[float, float]] = {}

    def take(self, name: str) -> tuple[int, float]:
        """Take one request; returns how many are left, and the seconds to wait if there was none.

        Examples
        --------
        >>> buckets = Buckets(Rate(2, 60.0), clock=lambda: 0.0)
        >>> [buckets.take("me") for _ in range(3)]
        [(1, 0.0), (0, 0.0), (0, 30.0)]
        """
        now = self._clock()
        speed = self.rate.count / self.rate.seconds
        with self._lock:
            level, at = self._levels.get(name, (float(self.rate.count), now))
            level = min(float(self.rate.count), level + (now - at) * speed)
            wait = 0.0 if level >= 1.0 else (1.0 - level) / speed
            if wait == 0.0:
                level -= 1.0
            self._levels[name] = level, now
            if len(self._levels) > PRUNE:
                self._forget(now, speed)
        return int(level), wait

    def _forget(self, now: float, speed: float) -> None:
        full = self.rate.count
        self._levels = {
            name: (level, at)
            for name, (level, at) in self._levels.items()
            if level + (now - at) * speed < full
        }
