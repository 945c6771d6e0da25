"""The client behind ``adret submit``: one call a step, progress on the terminal."""

import json
import os
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import httpx
from rich.console import Console
from rich.progress import BarColumn, DownloadColumn, Progress, TaskProgressColumn, TextColumn

__all__ = ["Client", "ClientError", "parse_inputs", "run_submit"]

CHUNK = 1 << 20
POLL = (0.1, 2.0)
PATIENCE = 60.0  # seconds that a service may be away while a job runs


class ClientError(Exception):
    """One line for the person at the terminal."""


class Client:
    """Talks to one service.

    Parameters
    ----------
    url : str
        Address of the service.
    key : str, optional
        API key.
    transport : httpx.BaseTransport, optional
        Replaces the network, for tests.
    """

    def __init__(
        self, url: str, key: str | None = None, transport: httpx.BaseTransport | None = None
    ) -> None:
        self._http = httpx.Client(
            base_url=url,
            headers={} if key is None else {"Authorization": f"Bearer {key}"},
            timeout=httpx.Timeout(60.0, write=300.0),
            transport=transport,
        )

    def close(self) -> None:
        """Close the connections."""
        self._http.close()

    def upload(
        self,
        dem: Path,
        sent: Callable[[int], None] = lambda _: None,
        camera: str | None = None,
    ) -> str:
        """Send a raster and return the id of its dataset; `sent` gets the bytes of each piece.

        With the text of a camera's JSON object it is a depth buffer.
        """

        def pieces() -> Iterator[bytes]:
            with dem.open("rb") as file:
                while piece := file.read(CHUNK):
                    sent(len(piece))
                    yield piece

        name = dem.name.encode("ascii", "replace").decode().replace('"', "_")
        headers = {
            "Content-Type": "application/octet-stream",
            "Content-Length": str(dem.stat().st_size),
            "Content-Disposition": f'attachment; filename="{name}"',
        }
        query = {} if camera is None else {"camera": camera}
        answer = self._ask("POST", "/uploads", params=query, content=pieces(), headers=headers)
        return str(answer.json()["id"])

    def submit(self, process: str, inputs: dict[str, Any]) -> str:
        """Order a computation and return the id of its job."""
        answer = self._ask("POST", f"/processes/{process}/execution", json={"inputs": inputs})
        return str(answer.json()["jobID"])

    def status(self, job: str) -> dict[str, Any]:
        """Return the job's status."""
        return dict(self._ask("GET", f"/jobs/{job}").json())

    def cancel(self, job: str) -> None:
        """Dismiss the job."""
        self._ask("DELETE", f"/jobs/{job}")

    def wait(self, job: str, seen: Callable[[dict[str, Any]], None] = lambda _: None) -> None:
        """Wait for the end of a job; a service that restarts meanwhile is waited for.

        Raises
        ------
        ClientError
            If the job fails or is dismissed, or if the service stays away.
        """
        pause, away = POLL[0], None
        while True:
            try:
                status = self.status(job)
                away = None
            except httpx.TransportError as error:
                away = away or time.monotonic()
                if time.monotonic() - away > PATIENCE:
                    raise ClientError(f"url: the service went away ({error})") from None
                time.sleep(1.0)
                continue
            seen(status)
            if status["status"] == "successful":
                return
            if status["status"] in ("failed", "dismissed"):
                raise ClientError(f"job {job}: {status['status']}: {status['message']}")
            time.sleep(pause)
            pause = min(pause * 1.3, POLL[1])

    def fetch(
        self, job: str, output: str, target: Path, got: Callable[[int, int], None] | None = None
    ) -> None:
        """Download one output; the file appears when it is whole and its digest is right."""
        import hashlib

        expected = self._ask("GET", f"/jobs/{job}/results").json()[output]
        path = f"/jobs/{job}/results/{output}"
        with draft_beside(target) as draft, self._http.stream("GET", path) as answer:
            if answer.status_code != 200:
                answer.read()
                raise refused(answer)
            digest = hashlib.sha256()
            with draft.open("wb") as file:
                for piece in answer.iter_bytes(CHUNK):
                    digest.update(piece)
                    file.write(piece)
                    if got is not None:
                        got(len(piece), expected["length"])
            if digest.hexdigest() != expected["sha256"]:
                raise ClientError(f"{output}: the download does not match its digest")

    def _ask(self, method: str, path: str, **options: Any) -> httpx.Response:
        answer = self._http.request(method, path, **options)
        if answer.is_error:
            raise refused(answer)
        return answer


def refused(answer: httpx.Response) -> ClientError:
    """Return the service's reason in one line."""
    try:
        return ClientError(str(answer.json()["detail"]))
    except (ValueError, KeyError, TypeError):
        return ClientError(f"url: the service answered {answer.status_code}")


@contextmanager
def draft_beside(target: Path) -> Iterator[Path]:
    """Yield a file that becomes `target` if the block ends well, and vanishes if not."""
    handle, name = tempfile.mkstemp(dir=target.parent, prefix=f".{target.name}-")
    os.close(handle)
    draft = Path(name)
    try:
        yield draft
        mask = os.umask(0)
        os.umask(mask)
        draft.chmod(0o666 & ~mask)
        os.replace(draft, target)
    finally:
        draft.unlink(missing_ok=True)


def parse_inputs(directions: int | None, options: list[str]) -> dict[str, Any]:
    """Turn ``name=value`` texts into inputs; a value that is no JSON is taken as text.

    Examples
    --------
    >>> parse_inputs(16, ["sun_deg=[315, 35]", "method=hull"])
    {'directions': 16, 'sun_deg': [315, 35], 'method': 'hull'}
    """
    inputs: dict[str, Any] = {} if directions is None else {"directions": directions}
    for option in options:
        name, equals, text = option.partition("=")
        if not equals or not name:
            raise ClientError(f"input: must be name=value, got {option!r}")
        try:
            inputs[name] = json.loads(text)
        except ValueError:
            inputs[name] = text
    return inputs


def run_submit(
    url: str,
    dem: Path,
    process: str,
    inputs: dict[str, Any],
    out: Path,
    preview: Path | None,
    camera: Path | None = None,
    *,
    key: str | None = None,
    overwrite: bool,
) -> None:
    """Upload, submit, wait and fetch, with a bar for each; an interrupt cancels the job."""
    check_paths(dem, [path for path in (out, preview) if path is not None], overwrite)
    seen = None if camera is None else camera_text(camera)
    columns = (TextColumn("{task.description}"), BarColumn(), TaskProgressColumn())
    client = Client(url, key)
    job = None
    try:
        with Progress(*columns, DownloadColumn(), console=Console(stderr=True)) as bars:
            sending = bars.add_task(f"send {dem.name}", total=dem.stat().st_size)
            dataset = client.upload(dem, lambda n: bars.advance(sending, n), seen)
        with Progress(*columns, console=Console(stderr=True)) as bars:
            job = client.submit(process, {"dataset": dataset, **inputs})
            running = bars.add_task("accepted", total=100)
            client.wait(
                job,
                lambda status: bars.update(
                    running, completed=status["progress"], description=status["status"]
                ),
            )
        finished, job = job, None
        with Progress(*columns, DownloadColumn(), console=Console(stderr=True)) as bars:
            for output, target in (("result", out), ("preview", preview)):
                if target is None:
                    continue
                fetching = bars.add_task(f"fetch {target.name}", total=None)
                client.fetch(
                    finished,
                    output,
                    target,
                    lambda n, total, task=fetching: (  # type: ignore[misc]
                        bars.update(task, total=total, advance=n)
                    ),
                )
    except httpx.TransportError as error:
        raise ClientError(f"url: must be a service that answers, got {url!r} ({error})") from None
    except BaseException:
        if job is not None:
            cancel_quietly(client, job)
        raise
    finally:
        client.close()


def camera_text(path: Path) -> str:
    """Return a camera file as short JSON."""
    try:
        members = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise ClientError(f"camera: must be a JSON file, got {path} ({error})") from None
    if not isinstance(members, dict):
        raise ClientError(f"camera: must be a JSON object, got {type(members).__name__}")
    return json.dumps(members, separators=(",", ":"))


def cancel_quietly(client: Client, job: str) -> None:
    """Dismiss a job whose client is leaving; nobody is left to hear of a failure."""
    try:
        if client.status(job)["status"] in ("accepted", "running"):
            client.cancel(job)
    except (ClientError, httpx.TransportError):
        return


def check_paths(dem: Path, targets: list[Path], overwrite: bool) -> None:
    """Refuse what can be known to fail before anything is sent."""
    if not dem.is_file():
        raise ClientError(f"dem: must be an existing file, got {str(dem)!r}")
    for target in targets:
        if not target.absolute().parent.is_dir():
            raise ClientError(f"out: must be in an existing folder, got {str(target)!r}")
        if target.is_dir():
            raise ClientError(f"out: must be a file name, not a folder, got {str(target)!r}")
        if target.exists() and not overwrite:
            raise ClientError(f"out: must be a new file (or use --overwrite), got {str(target)!r}")
