"""The command line's half of the service, and what it refuses before anything is sent."""

import hashlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import httpx
import pytest
from pydantic import ValidationError

from adret_service import client as module
from adret_service.client import Client, ClientError, check_paths, parse_inputs
from adret_service.settings import Settings


def answering(handler: Callable[[httpx.Request], httpx.Response]) -> Client:
    return Client("http://service", transport=httpx.MockTransport(handler))


def test_inputs_are_json_or_text() -> None:
    assert parse_inputs(8, ["a=1.5", "b=[1, 2]", "c=overcast", "d=null", "e=x=y"]) == {
        "directions": 8,
        "a": 1.5,
        "b": [1, 2],
        "c": "overcast",
        "d": None,
        "e": "x=y",
    }
    for wrong in ("novalue", "=3"):
        with pytest.raises(ClientError, match="input: must be name=value"):
            parse_inputs(None, [wrong])


def test_paths_are_checked_before_anything_is_sent(tmp_path: Path) -> None:
    dem = tmp_path / "dem.tif"
    dem.write_bytes(b"x")
    check_paths(dem, [tmp_path / "out.tif"], overwrite=False)
    for target, reason in (
        (tmp_path / "none" / "out.tif", "existing folder"),
        (tmp_path, "not a folder"),
        (dem, "new file"),
    ):
        with pytest.raises(ClientError, match=reason):
            check_paths(dem, [target], overwrite=False)
    check_paths(dem, [dem], overwrite=True)
    with pytest.raises(ClientError, match="dem: must be an existing file"):
        check_paths(tmp_path / "missing", [], overwrite=False)


def test_waiting_outlasts_a_restart_of_the_service(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module.time, "sleep", lambda _: None)
    states: list[Any] = ["accepted", None, None, "running", "successful"]

    def handler(request: httpx.Request) -> httpx.Response:
        state = states.pop(0)
        if state is None:
            raise httpx.ConnectError("refused", request=request)
        return httpx.Response(200, json={"status": state, "message": "", "progress": 0})

    seen: list[str] = []
    answering(handler).wait("j", lambda status: seen.append(status["status"]))
    assert seen == ["accepted", "running", "successful"]


def test_a_failed_job_raises_its_message(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module.time, "sleep", lambda _: None)
    failed = {"status": "failed", "message": "radius: must be known", "progress": 0}
    with pytest.raises(ClientError, match="job j: failed: radius: must be known"):
        answering(lambda _: httpx.Response(200, json=failed)).wait("j")


@pytest.mark.parametrize("right", [True, False])
def test_a_download_appears_only_whole(tmp_path: Path, right: bool) -> None:
    content = b"0123456789"
    digest = hashlib.sha256(content if right else b"other").hexdigest()

    def handler(request: httpx.Request) -> httpx.Response:
        if request.url.path.endswith("/results"):
            return httpx.Response(200, json={"result": {"length": 10, "sha256": digest}})
        return httpx.Response(200, content=content)

    target = tmp_path / "out.tif"
    if right:
        answering(handler).fetch("j", "result", target)
        assert target.read_bytes() == content
    else:
        with pytest.raises(ClientError, match="digest"):
            answering(handler).fetch("j", "result", target)
    assert list(tmp_path.iterdir()) == ([target] if right else [])


def test_a_refusal_without_json_is_still_one_line() -> None:
    with pytest.raises(ClientError, match="url: the service answered 502"):
        answering(lambda _: httpx.Response(502, text="<html>")).submit("p", {})


def test_settings_come_from_the_environment_and_refuse_too_many_threads(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("ADRET_DATA_DIR", str(tmp_path))
    monkeypatch.setenv("ADRET_QUEUE_MAX", "7")
    settings = Settings()
    assert (settings.data_dir, settings.queue_max) == (tmp_path, 7)
    assert settings.database == f"sqlite:///{tmp_path / 'adret.db'}"
    assert settings.threads >= 1
    with pytest.raises(ValidationError, match="got 4096"):
        Settings(workers=16, job_slots=16, threads_per_job=16)
    monkeypatch.setenv("ADRET_QUEUE_MAX", "none")
    with pytest.raises(ValidationError):
        Settings()
