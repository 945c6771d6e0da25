"""What an API process does beside answering: callbacks are sent."""

from typing import Self

import sqlalchemy as sa

from adret_service.callbacks import Herald
from adret_service.settings import Settings
from adret_service.storage import Storage

__all__ = ["Upkeep"]


class Upkeep:
    """Background work of a service on a database; a context that starts and stops it.

    Parameters
    ----------
    settings : Settings
    database : sqlalchemy.Engine
    storage : Storage
    """

    def __init__(self, settings: Settings, database: sa.Engine, storage: Storage) -> None:
        self._herald = Herald(settings, database, storage) if settings.webhook_hosts else None

    def __enter__(self) -> Self:
        """Start."""
        if self._herald is not None:
            self._herald.start()
        return self

    def __exit__(self, *_: object) -> None:
        """Stop."""
        if self._herald is not None:
            self._herald.stop()
