"""Datasets: elevation rasters that passed the gate, as rows of the database."""

import math
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import sqlalchemy as sa
from sqlalchemy.exc import IntegrityError

from adret_service.database import datasets, jobs
from adret_service.engine.ledger import OPEN
from adret_service.ids import new_id
from adret_service.storage import HEIGHTS, Storage

__all__ = ["Dataset", "DatasetCatalogue", "wait_for_orders"]

GEOTIFF = "image/tiff; application=geotiff"


LOOKING = sa.select(datasets).where(datasets.c.id.in_(sa.bindparam("ids", expanding=True)))


@dataclass(frozen=True, slots=True, kw_only=True)
class Dataset:
    """One dataset; `key` is its raster in the store, `info` what the decoder found."""

    id: str
    tenant: str
    sha256: str
    name: str
    upload_bytes: int
    created: float
    key: str
    info: Mapping[str, Any]


class DatasetCatalogue:
    """The datasets of all tenants.

    Parameters
    ----------
    database : sqlalchemy.Engine
        An open database.
    storage : Storage
        Where the rasters are.
    """

    def __init__(self, database: sa.Engine, storage: Storage) -> None:
        self.database = database
        self.storage = storage

    def find(self, tenant: str, sha256: str) -> Dataset | None:
        """Return the dataset that the tenant made from an equal upload."""
        return self._one(datasets.c.tenant == tenant, datasets.c.sha256 == sha256)

    def get(self, dataset_id: str, tenant: str) -> Dataset | None:
        """Return the tenant's dataset or None."""
        return self._one(datasets.c.id == dataset_id, datasets.c.tenant == tenant)

    def look(self, dataset_ids: Sequence[str]) -> Mapping[str, Dataset]:
        """Return those of these datasets that there are, whoever's they are, in one read."""
        with self.database.connect() as connection:
            rows = connection.execute(LOOKING, {"ids": [*dataset_ids]}).all()
        return {row.id: Dataset(**row._mapping) for row in rows}

    def list(self, tenant: str, *, limit: int = 100, before: str | None = None) -> list[Dataset]:
        """Return the tenant's datasets, newest first, those with an id below `before`."""
        query = sa.select(datasets).where(datasets.c.tenant == tenant)
        if before is not None:
            query = query.where(datasets.c.id < before)
        with self.database.connect() as connection:
            rows = connection.execute(query.order_by(datasets.c.id.desc()).limit(limit)).all()
        return [Dataset(**row._mapping) for row in rows]

    def stored_bytes(self, tenant: str) -> int:
        """Return the bytes of all the tenant's uploads."""
        query = sa.select(sa.func.coalesce(sa.func.sum(datasets.c.upload_bytes), 0))
        with self.database.connect() as connection:
            return int(connection.execute(query.where(datasets.c.tenant == tenant)).scalar_one())

    def add(
        self,
        tenant: str,
        raster: Path,
        *,
        sha256: str,
        name: str,
        upload_bytes: int,
        info: Mapping[str, Any],
    ) -> Dataset:
        """Take a decoded raster into the store, then into the catalogue.

        When two equal uploads race, both get the dataset of the first.
        """
        dataset_id = new_id()
        prefix = f"{tenant}/datasets/{dataset_id}"
        try:
            artefact = self.storage.publish(raster, prefix, HEIGHTS, GEOTIFF)
            self.storage.write_manifest(prefix, {"heights": artefact}, {"name": name})
            dataset = Dataset(
                id=dataset_id,
                tenant=tenant,
                sha256=sha256,
                name=name,
                upload_bytes=upload_bytes,
                created=time.time(),
                key=artefact.key,
                info=info,
            )
            fields = {column.name: getattr(dataset, column.name) for column in datasets.columns}
            with self.database.begin() as connection:
                connection.execute(datasets.insert().values(**fields | {"info": dict(info)}))
        except IntegrityError:
            self.storage.delete(prefix)
            twin = self.find(tenant, sha256)
            if twin is None:
                raise
            return twin
        except BaseException:
            self.storage.delete(prefix)
            raise
        return dataset

    def delete(self, dataset_id: str, tenant: str) -> bool:
        """Delete a dataset that no unfinished job reads; False if it is unknown or in use."""
        in_use = sa.exists().where(jobs.c.dataset == dataset_id, OPEN)
        statement = datasets.delete().where(
            datasets.c.id == dataset_id, datasets.c.tenant == tenant, ~in_use
        )
        with self.database.begin() as connection:
            wait_for_orders(connection, dataset_id)
            deleted = connection.execute(statement).rowcount == 1
        if deleted:
            self.storage.delete(f"{tenant}/datasets/{dataset_id}")
        return deleted

    def sweep(self, older_than: float = 3600.0) -> int:
        """Delete what a crash left in the store without a row; returns how many folders.

        Parameters
        ----------
        older_than : float
            Age [s] below which a folder may still be on its way into the catalogue.
        """
        swept = 0
        for kind, table in (("datasets", datasets), ("jobs", jobs)):
            for prefix, age in self.storage.prefixes(kind):
                if age < older_than:
                    continue
                query = sa.select(table.c.id).where(table.c.id == prefix.rsplit("/", 1)[-1])
                with self.database.connect() as connection:
                    known = connection.execute(query).first() is not None
                if not known:
                    self.storage.delete(prefix)
                    swept += 1
        return swept

    def _one(self, *conditions: Any) -> Dataset | None:
        with self.database.connect() as connection:
            row = connection.execute(sa.select(datasets).where(*conditions)).first()
        return None if row is None else Dataset(**row._mapping)


def wait_for_orders(connection: sa.Connection, dataset_id: str) -> None:
    """Wait for orders that are being accepted for a dataset, and hold up new ones.

    An order locks the dataset that it names. PostgreSQL does not look at a deletion's condition
    again after it waited for such a lock: the condition must come in a later statement.
    """
    query = sa.select(datasets.c.id).where(datasets.c.id == dataset_id)
    connection.execute(query.with_for_update()).first()


def public(dataset: Dataset) -> dict[str, Any]:
    """Return what a client may see of a dataset."""
    info = {k: v for k, v in dataset.info.items() if k != "options"}
    return {
        "id": dataset.id,
        "name": dataset.name,
        "sha256": dataset.sha256,
        "size": dataset.upload_bytes,
        "created": timestamp(dataset.created),
        **info,
    }


def timestamp(seconds: float | None) -> str | None:
    """Return Unix seconds as RFC 3339 in UTC with milliseconds."""
    if seconds is None:
        return None
    whole, part = divmod(math.floor(seconds * 1000), 1000)
    return f"{time.strftime('%Y-%m-%dT%H:%M:%S', time.gmtime(whole))}.{part:03d}Z"
