"""Where the tiles of large jobs wait: one folder a job, which outlives whoever works in it.

A worker, its computing process or the whole server may die: the next attempt at the job finds the
tiles that are done, on the same disk. The folder goes when the job has ended well or is removed,
and before that if room is short and the job failed or was dismissed.
"""

import shutil
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from adret_service.engine.port import JobRecord, JobStatus
from adret_service.scratch import scratch_bytes
from adret_service.settings import Settings

__all__ = ["TileFolders"]

Look = Callable[[Sequence[str]], Mapping[str, JobRecord]]


class TileFolders:
    """The folders of this machine's jobs.

    Parameters
    ----------
    settings : Settings
        Scratch space and its limits.
    """

    def __init__(self, settings: Settings) -> None:
        self.settings = settings
        self.root = settings.scratch_dir / "tiles"

    def open(self, job_id: str) -> Path:
        """Return the folder of a job, made if need be."""
        folder = self.root / job_id
        folder.mkdir(parents=True, exist_ok=True, mode=0o700)
        return folder.absolute()

    def drop(self, job_id: str) -> None:
        """Forget what was made of a job."""
        shutil.rmtree(self.root / job_id, ignore_errors=True)

    def others(self, job_id: str) -> int:
        """Bytes of work in progress on this machine but for the job's own tiles."""
        return scratch_bytes(self.settings.scratch_dir) - scratch_bytes(self.root / job_id)

    def room(self, job_id: str) -> int:
        """Bytes that the job's tiles may take, those that are there included."""
        scratch = self.settings.scratch_dir
        free = shutil.disk_usage(scratch).free + scratch_bytes(self.root / job_id)
        return min(
            free - self.settings.min_free_bytes,
            self.settings.scratch_max_bytes - self.others(job_id),
        )

    def sweep(self, look: Look) -> int:
        """Drop the folders that nobody will need, and if room is short, those nobody may need.

        Parameters
        ----------
        look : callable
            Gives the jobs of some ids, those that there are.

        Returns
        -------
        int
            Folders that were dropped.
        """
        if not self.root.is_dir():
            return 0
        there = sorted(path.name for path in self.root.iterdir())
        if not there:
            return 0
        jobs = look(there)
        needless = [
            each for each in there if each not in jobs or jobs[each].status is JobStatus.SUCCESSFUL
        ]
        for each in needless:
            self.drop(each)
        ended = [job for job in jobs.values() if job.is_finished and job.id not in needless]
        for job in sorted(ended, key=lambda job: job.finished or 0.0):
            if not self.crowded():
                break
            self.drop(job.id)
            needless.append(job.id)
        return len(needless)

    def crowded(self) -> bool:
        """Whether there is more work in progress, or less free space, than there may be."""
        scratch = self.settings.scratch_dir
        return (
            scratch_bytes(scratch) > self.settings.scratch_max_bytes
            or shutil.disk_usage(scratch).free < self.settings.min_free_bytes
        )
