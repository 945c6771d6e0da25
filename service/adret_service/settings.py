"""Everything an operator can set, as ``ADRET_*`` environment variables or arguments."""

import os
from pathlib import Path
from typing import Literal, Self

from pydantic import Field, field_validator, model_validator
from pydantic_settings import BaseSettings, SettingsConfigDict

from adret_service.rates import Rate

__all__ = ["WORKFLOW_VERSION", "Settings"]

# Raised only when a job of the old version could not be finished by the new code.
WORKFLOW_VERSION = "adret-wf-1"

KIB, MIB, GIB = 1 << 10, 1 << 20, 1 << 30
SECRET_LENGTH = 16  # characters of the secret that signs callbacks, at least


def _default_data_dir() -> Path:
    base = os.environ.get("XDG_DATA_HOME")
    return (Path(base) if base else Path.home() / ".local" / "share") / "adret"


class Settings(BaseSettings):
    """Settings of one service; immutable once built.

    Sizes are bytes and times are seconds unless the name says otherwise.

    Examples
    --------
    >>> Settings(data_dir="/tmp/adret", port=8001).store_dir.as_posix()
    '/tmp/adret/store'
    """

    model_config = SettingsConfigDict(env_prefix="ADRET_", frozen=True, extra="forbid")

    data_dir: Path = Field(default_factory=_default_data_dir)
    database_url: str = ""
    storage_url: str = Field(default="", pattern=r"^(s3://[^/]+(/.*)?)?$")
    storage_endpoint: str = ""
    storage_allow_http: bool = False

    host: str = "127.0.0.1"
    port: int = Field(default=8000, ge=0, le=65535)
    base_url: str = ""
    allow_insecure_bind: bool = False
    auth: Literal["none", "apikey"] = "none"
    api_keys_file: Path | None = None
    rate_api: str = "1200/m"
    rate_submit: str = "120/m"
    rate_tiles: str = "12000/m"
    token_secret: str = Field(default="", repr=False)
    token_seconds: float = Field(default=86400.0, gt=0)
    tenant_max_jobs: int = Field(default=100, ge=1)
    tenant_max_bytes: int = Field(default=50 * GIB, ge=1)
    tenant_cells_per_day: int = Field(default=100_000_000_000, ge=1)
    role: Literal["all", "api"] = "all"

    workers: int = Field(default=1, ge=0, le=256)
    job_slots: int = Field(default=1, ge=1, le=64)
    threads_per_job: int = Field(default=0, ge=0)
    job_timeout: float = Field(default=86400.0, gt=0)
    job_max_attempts: int = Field(default=3, ge=1)
    job_max_revivals: int = Field(default=20, ge=1)
    cancel_grace: float = Field(default=0.2, ge=0)
    tiled_cells: int = Field(default=16_000_000, ge=0)
    tiled_seconds: float = Field(default=60.0, ge=0)
    tile_size: int = Field(default=2048, ge=16)
    compute_nice: int = Field(default=10, ge=0, le=19)
    queue_poll: float = Field(default=0.25, gt=0)
    queue_max: int = Field(default=1000, ge=1)
    liveness_interval: float = Field(default=2.0, gt=0)
    liveness_grace: float = Field(default=10.0, ge=0)

    enable_echo: bool = False
    sync_wait: float = Field(default=30.0, gt=0, le=300.0)
    sync_max_cells: int = Field(default=4_000_000, ge=0)
    sync_slots: int = Field(default=32, ge=0)
    inline_max_bytes: int = Field(default=16 * MIB, ge=0)
    webhook_hosts: str = ""
    webhook_secret: str = Field(default="", repr=False)
    webhook_allow_private: bool = False
    webhook_attempts: int = Field(default=6, ge=1, le=20)
    webhook_pause: float = Field(default=1.0, gt=0)

    retention_days: float = Field(default=7.0, ge=0)
    keep_failed_days: float = Field(default=2.0, ge=0)
    dataset_days: float = Field(default=0.0, ge=0)
    sweep_interval: float = Field(default=300.0, gt=0)
    scratch_max_bytes: int = Field(default=100 * GIB, ge=1)

    max_body_bytes: int = Field(default=1 * MIB, ge=1)
    max_upload_bytes: int = Field(default=2 * GIB, ge=1)
    max_pixels: int = Field(default=1_000_000_000, ge=1)
    max_dim: int = Field(default=200_000, ge=1)
    max_bands: int = Field(default=16, ge=1)
    max_block_bytes: int = Field(default=64 * MIB, ge=1)
    max_ratio: float = Field(default=200.0, gt=1)
    ratio_floor_bytes: int = Field(default=64 * MIB, ge=0)
    allow_exr: bool = False
    ingest_memory: int = Field(default=4 * GIB, ge=256 * MIB)
    ingest_timeout: float = Field(default=120.0, gt=0)
    ingest_slots: int = Field(default=2, ge=1)
    upload_idle: float = Field(default=60.0, gt=0)
    upload_ttl: float = Field(default=86400.0, gt=0)
    min_free_bytes: int = Field(default=1 * GIB, ge=0)

    viewers: int = Field(default_factory=lambda: min(2, os.cpu_count() or 1), ge=1, le=64)
    view_timeout: float = Field(default=20.0, gt=0)
    view_cache_bytes: int = Field(default=10 * GIB, ge=0)

    log_level: Literal["debug", "info", "warning", "error"] = "info"
    log_json: bool = False
    otel_endpoint: str = ""

    @model_validator(mode="after")
    def _threads_fit(self) -> Self:
        cores = os.cpu_count() or 1
        wanted = max(self.workers, 1) * self.job_slots * self.threads_per_job
        if wanted > cores:
            raise ValueError(
                f"workers × job_slots × threads_per_job: must be at most {cores} (cores), "
                f"got {wanted}"
            )
        return self

    @model_validator(mode="after")
    def _callbacks_are_signed(self) -> Self:
        if self.webhook_hosts and len(self.webhook_secret) < SECRET_LENGTH:
            raise ValueError(
                f"webhook_secret: must be of at least {SECRET_LENGTH} characters with "
                f"webhook_hosts, got {len(self.webhook_secret)}"
            )
        return self

    @field_validator("rate_api", "rate_submit", "rate_tiles")
    @classmethod
    def _is_rate(cls, text: str) -> str:
        Rate.parse(text)
        return text

    @property
    def keys_file(self) -> Path:
        """File of the API keys' digests."""
        return self.api_keys_file or self.data_dir / "keys.json"

    @property
    def threads(self) -> int:
        """Kernel threads of one job: as asked, or the cores shared among all slots."""
        cores = os.cpu_count() or 1
        return self.threads_per_job or max(1, cores // (max(self.workers, 1) * self.job_slots))

    @property
    def database(self) -> str:
        """URL of the database that holds jobs, datasets and the queue."""
        return self.database_url or f"sqlite:///{self.data_dir.absolute() / 'adret.db'}"

    @property
    def store_dir(self) -> Path:
        """Folder of finished artefacts."""
        return self.data_dir / "store"

    @property
    def scratch_dir(self) -> Path:
        """Folder of work in progress, on the same file system as the store."""
        return self.data_dir / "tmp"

    @property
    def locks_dir(self) -> Path:
        """Folder of the locks that tell live processes from dead ones."""
        return self.data_dir / "locks"
