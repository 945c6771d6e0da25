"""Few reads for many askers: whoever asks while one read goes on shares the next."""

import asyncio
from collections.abc import Callable, Mapping
from typing import Generic, TypeVar

from anyio import CapacityLimiter
from anyio.to_thread import run_sync

__all__ = ["Lookup"]

T = TypeVar("T")


class Lookup(Generic[T]):
    """Answers by id from a database that many clients ask at once.

    Every answer comes from a read that began after the question, so nobody is told less than the
    database knew then; but of all who ask while a read goes on, one next read serves all. Two
    hundred clients that poll cost a few reads a second more than one does.

    Parameters
    ----------
    read : callable
        Takes ids and returns what there is of them; it is called in a thread, once at a time.
    """

    def __init__(self, read: Callable[[list[str]], Mapping[str, T]]) -> None:
        self._read = read
        self._asked: dict[str, asyncio.Future[T | None]] = {}
        self._reader: asyncio.Task[None] | None = None
        self._turn = CapacityLimiter(1)  # its own: other work in threads must not delay it

    async def get(self, key: str) -> T | None:
        """Return what is known under an id, None if nothing is.

        Raises
        ------
        Exception
            Whatever the read raised, to each who waited for it.
        """
        loop = asyncio.get_running_loop()
        found = self._asked.get(key)
        if found is None:
            found = self._asked[key] = loop.create_future()
        if self._reader is None:
            self._reader = loop.create_task(self._serve())
        return await asyncio.shield(found)

    async def _serve(self) -> None:
        try:
            while self._asked:
                asked, self._asked = self._asked, {}
                try:
                    known = await run_sync(self._read, list(asked), limiter=self._turn)
                except Exception as error:
                    for future in asked.values():
                        future.set_exception(error)
                else:
                    for key, future in asked.items():
                        future.set_result(known.get(key))
        finally:
            self._reader = None
