"""What an API process does beside answering: callbacks are sent, and what is old goes."""

from typing import Self

from adret_service.callbacks import Herald
from adret_service.datasets import DatasetCatalogue
from adret_service.engine.durable import DurableEngine
from adret_service.retention import Janitor
from adret_service.settings import Settings

__all__ = ["Upkeep"]


class Upkeep:
    """Background work of a service; a context that starts and stops it.

    Parameters
    ----------
    settings : Settings
    engine : DurableEngine
    catalogue : DatasetCatalogue
    """

    def __init__(
        self, settings: Settings, engine: DurableEngine, catalogue: DatasetCatalogue
    ) -> None:
        self._janitor = Janitor(settings, engine, catalogue)
        self._herald = None
        if settings.webhook_hosts:
            self._herald = Herald(settings, engine.database, catalogue.storage)

    def __enter__(self) -> Self:
        """Start."""
        self._janitor.start()
        if self._herald is not None:
            self._herald.start()
        return self

    def __exit__(self, *_: object) -> None:
        """Stop."""
        self._janitor.stop()
        if self._herald is not None:
            self._herald.stop()
