"""The typed client against services that misbehave, and what it refuses to send at all."""

import hashlib
import json
import stat
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import httpx
import pytest
from pydantic import ValidationError

from adret_service.client import downloads, following, session, uploads
from adret_service.client.credentials import Credentials
from adret_service.client.downloads import fetch, part_of
from adret_service.client.errors import AWAY, ENDED, WRONG, ClientError
from adret_service.client.following import follow, successful
from adret_service.client.inputs import camera_text, check_source, check_targets, parse_values
from adret_service.client.records import Job, Output
from adret_service.client.session import Client
from adret_service.settings import Settings

Handler = Callable[[httpx.Request], httpx.Response]
CONTENT = bytes(range(256)) * 40


@pytest.fixture(autouse=True)
def naps(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """Nobody sleeps; what they would have slept."""
    taken: list[float] = []
    for module in (session, following, downloads, uploads):
        monkeypatch.setattr(module.time, "sleep", taken.append)
    return taken


def answering(handler: Handler, **options: Any) -> Client:
    return Client("http://service", transport=httpx.MockTransport(handler), **options)


def job(status: str, **fields: Any) -> dict[str, Any]:
    return {"jobID": "j", "status": status, "message": "", "progress": 0, **fields}


def test_inputs_are_json_or_text() -> None:
    assert parse_values(["a=1.5", "b=[1, 2]", "c=overcast", "d=null", "e=x=y"]) == {
        "a": 1.5,
        "b": [1, 2],
        "c": "overcast",
        "d": None,
        "e": "x=y",
    }
    for wrong in ("novalue", "=3"):
        with pytest.raises(ClientError, match="input: must be name=value"):
            parse_values([wrong])


def test_files_are_checked_before_anything_is_sent(tmp_path: Path) -> None:
    dem = tmp_path / "dem.tif"
    dem.write_bytes(b"x")
    assert check_source(dem) == dem
    check_targets([tmp_path / "out.tif"], overwrite=False)
    for target, reason in (
        (tmp_path / "none" / "out.tif", "existing folder"),
        (tmp_path, "not a folder"),
        (dem, "new file"),
    ):
        with pytest.raises(ClientError, match=reason):
            check_targets([target], overwrite=False)
    check_targets([dem], overwrite=True)
    with pytest.raises(ClientError, match="file: must be an existing file"):
        check_source(tmp_path / "missing")
    dem.write_text('{"width": 3}')
    assert camera_text(dem) == '{"width":3}'
    for text, reason in (("[1]", "must be a JSON object, got list"), ("{", "must be a JSON file")):
        dem.write_text(text)
        with pytest.raises(ClientError, match=f"camera: {reason}"):
            camera_text(dem)


@pytest.mark.parametrize("url", ["service", "file:///etc/passwd", "ftp://service", ""])
def test_an_address_that_is_none_is_refused(url: str) -> None:
    with pytest.raises(ClientError, match="url: must begin with"):
        Client(url)


def test_a_refusal_is_told_as_the_service_put_it() -> None:
    problem = {"detail": "inputs.directions: must be at least 1,\n got 0", "request_id": "r7"}
    answers = [(400, problem, WRONG, r"inputs.directions: must be at least 1, got 0$")]
    answers += [(500, problem, AWAY, r"got 0 \(request r7\)$")]
    answers += [(401, {"detail": "an API key is needed"}, WRONG, "needed .*adret login")]
    for status, body, code, text in answers:
        with pytest.raises(ClientError, match=text) as caught:
            answering(lambda _, s=status, b=body: httpx.Response(s, json=b)).job("j")
        assert (caught.value.code, caught.value.problem) == (code, body)
    with pytest.raises(ClientError, match="url: the service answered 500"):
        answering(lambda _: httpx.Response(500, text="<html>")).job("j")


def test_an_id_cannot_lead_to_another_path() -> None:
    client = answering(lambda _: httpx.Response(200, json=job("successful")))
    for text in ("../datasets/x", "a/b", "a?b", "", "ä"):
        with pytest.raises(ClientError, match="id: must be letters"):
            client.job(text)


def test_a_service_that_never_answered_is_given_up_at_once(naps: list[float]) -> None:
    def refuse(request: httpx.Request) -> httpx.Response:
        raise httpx.ConnectError("refused", request=request)

    with pytest.raises(ClientError, match="url: must be a service that answers") as caught:
        answering(refuse).job("j")
    assert (caught.value.code, naps) == (AWAY, [])


def test_later_is_waited_for_as_long_as_it_asks_and_no_longer(naps: list[float]) -> None:
    later = httpx.Response(429, headers={"Retry-After": "7"}, json={"detail": "too often"})
    answers = [later, httpx.Response(502), httpx.Response(200, json=job("running"))]
    assert answering(lambda _: answers.pop(0)).job("j").status == "running"
    assert naps[0] == 7.0
    with pytest.raises(ClientError, match=r"too often \(again in 7 s\)"):
        answering(lambda _: later, patience=5.0).job("j")


def test_an_upload_that_breaks_starts_again(tmp_path: Path) -> None:
    file, bodies, sent = tmp_path / "dem.tif", [], []
    file.write_bytes(CONTENT)
    answers: list[Any] = [None, httpx.Response(503)]
    answers += [httpx.Response(201, json={"id": "d", "rows": 2, "columns": 3})]

    def handler(request: httpx.Request) -> httpx.Response:
        bodies.append(request.read())
        answer = answers.pop(0)
        if answer is None:
            raise httpx.ReadError("broken", request=request)
        return answer

    client = answering(handler)
    client._reached = True
    dataset = client.upload(file, {"band": 2}, sent.append)
    assert (dataset.id, dataset.rows, dataset.columns) == ("d", 2, 3)
    assert bodies == [CONTENT] * 3
    assert sent == [0, len(CONTENT)] * 3


class Tus:
    """A service that takes pieces, and loses connections when it is told to."""

    def __init__(self, *breaks: int) -> None:
        self.breaks = list(breaks)  # each piece is cut after so many bytes
        self.body = b""
        self.begun = 0
        self.plain = 0

    def __call__(self, request: httpx.Request) -> httpx.Response:
        dataset = {"id": "d", "rows": 2, "columns": 3}
        if request.url.path == "/uploads":
            self.plain += 1
            return httpx.Response(201, json=dataset)
        if request.url.path == "/datasets/d":
            return httpx.Response(200, json=dataset)
        if request.method == "POST":
            self.begun += 1
            assert request.headers["upload-length"] == str(len(CONTENT))
            assert dict(request.url.params) == {"band": "2"}
            return httpx.Response(201, headers={"location": "http://front/uploads/tus/u1"})
        assert request.url.path == "/uploads/tus/u1"
        if not self.begun:
            return httpx.Response(404, json={"detail": "no such upload", "status": 404})
        if request.method == "GET":
            state: dict[str, Any] = {"offset": len(self.body)}
            done = len(self.body) == len(CONTENT)
            return httpx.Response(200, json=state | ({"dataset": "d"} if done else {}))
        assert request.headers["upload-offset"] == str(len(self.body))
        piece = request.read()
        if self.breaks:
            self.body += piece[: self.breaks.pop(0)]
            raise httpx.WriteError("broken", request=request)
        self.body += piece
        return httpx.Response(204)


def test_a_large_upload_goes_on_where_it_broke_off(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(uploads, "WHOLE", 100)
    monkeypatch.setattr(uploads, "PIECE", 4000)
    file, notes, sent = tmp_path / "dem.tif", tmp_path / "notes", []
    file.write_bytes(CONTENT)
    service = Tus(1000, 0, 10)
    dataset = uploads.upload(answering(service), file, {"band": 2}, sent.append, notes)
    assert (dataset.id, service.body, service.begun) == ("d", CONTENT, 1)
    assert list(notes.iterdir()) == []
    assert sent == sorted(sent)
    assert sent[-1] == len(CONTENT)

    service = Tus(1000)
    with pytest.raises(ClientError, match="must be a service that answers"):
        uploads.upload(answering(service, patience=-1), file, {"band": 2}, sent.append, notes)
    assert uploads.upload(answering(service), file, {"band": 2}, sent.append, notes).id == "d"
    assert (service.body, service.begun) == (CONTENT, 1)

    (notes / uploads.name_of(answering(service), file, {"band": 2})).write_text("u1")
    service = Tus()
    uploads.upload(answering(service), file, {"band": 2}, sent.append, notes)
    assert (service.body, service.begun, service.plain) == (CONTENT, 1, 0)

    def without(request: httpx.Request) -> httpx.Response:
        if request.url.path.startswith("/uploads/tus"):
            return httpx.Response(404, json={"detail": "Not Found", "status": 404})
        return service(request)

    assert uploads.upload(answering(without), file, {"band": 2}, sent.append, notes).id == "d"
    assert service.plain == 1


def test_an_order_that_is_repeated_keeps_its_key() -> None:
    keys, answers = [], [httpx.Response(503), httpx.Response(201, json=job("accepted"))]

    def handler(request: httpx.Request) -> httpx.Response:
        keys.append(request.headers["idempotency-key"])
        return answers.pop(0)

    client = answering(handler)
    assert client.submit("light", {"dataset": "d"}).id == "j"
    assert len(set(keys)) == 1
    answers += [httpx.Response(201, json=job("accepted"))]
    client.submit("light", {"dataset": "d"})
    assert len(keys[0]) >= 16
    assert keys[2] != keys[0]


def test_a_cancel_whose_answer_is_lost_does_not_remove_the_job() -> None:
    state, deletes = ["running"], []

    def handler(request: httpx.Request) -> httpx.Response:
        if request.method == "DELETE":
            deletes.append(1)
            state[0] = "dismissed"
            raise httpx.ReadTimeout("lost", request=request)
        return httpx.Response(200, json=job(state[0]))

    assert answering(handler).cancel("j").status == "dismissed"
    assert deletes == [1]


class Stream(httpx.SyncByteStream):
    """A body that ends in an error if the last piece is one."""

    def __init__(self, *pieces: str | Exception) -> None:
        self.pieces = pieces

    def __iter__(self) -> Iterator[bytes]:
        for piece in self.pieces:
            if isinstance(piece, Exception):
                raise piece
            yield piece.encode()


def sse(*pieces: str | Exception) -> httpx.Response:
    headers = {"content-type": "text/event-stream; charset=utf-8"}
    return httpx.Response(200, headers=headers, stream=Stream(*pieces))


def test_a_stream_that_breaks_is_taken_up_after_the_last_event() -> None:
    first = 'id: 4\nevent: status\ndata: {"status": "running"}\n\n: ping\n\nid: 6\nevent: prog'
    rest = 'ress\ndata: {"progress": 30}\n\n'
    end = 'id: 9\nevent: status\ndata: {"status": "successful"}\n\n'
    end += 'event: end\ndata: {"status": "successful"}\n\n'
    streams = [sse(first, rest, httpx.ReadError("broken")), httpx.ReadTimeout("silence"), sse(end)]
    asked = []

    def handler(request: httpx.Request) -> httpx.Response:
        if not request.url.path.endswith("/events"):
            return httpx.Response(200, json=job("running"))
        asked.append(request.headers["last-event-id"])
        answer = streams.pop(0)
        if isinstance(answer, Exception):
            raise answer
        return answer

    seen = [(event.seq, event.kind) for event in follow(answering(handler), "j")]
    assert seen == [(4, "status"), (6, "progress"), (9, "status"), (None, "end")]
    assert asked == ["0", "6", "6"]


@pytest.mark.parametrize("stream", [404, "html", "mute"])
def test_where_there_is_no_stream_the_job_is_looked_at(stream: object) -> None:
    states = ["accepted", "accepted", "running", "running", "successful"]
    states = ["accepted"] * (2 if stream == "mute" else 0) + states

    def handler(request: httpx.Request) -> httpx.Response:
        if not request.url.path.endswith("/events"):
            return httpx.Response(200, json=job(states.pop(0)))
        if stream == "mute":
            raise httpx.ReadTimeout("silence", request=request)
        return httpx.Response(404) if stream == 404 else httpx.Response(200, html="<html>")

    seen = [event.body["status"] for event in follow(answering(handler), "j")]
    assert seen == ["accepted", "running", "successful", "successful"]
    assert states == []


def test_following_outlasts_a_restart_and_not_a_job_that_is_gone(naps: list[float]) -> None:
    answers: list[Any] = [job("running"), None, None, job("running"), job("successful")]

    def handler(request: httpx.Request) -> httpx.Response:
        if request.url.path.endswith("/events"):
            return httpx.Response(404)
        answer = answers.pop(0) if answers else 404
        if answer is None:
            raise httpx.ConnectError("refused", request=request)
        if answer == 404:
            return httpx.Response(404, json={"detail": "no such job"})
        return httpx.Response(200, json=answer)

    client = answering(handler)
    assert [event.kind for event in follow(client, "j")] == ["status", "status", "end"]
    with pytest.raises(ClientError, match="no such job"):
        list(follow(client, "j"))


def test_a_job_that_ended_badly_says_why() -> None:
    failed = Job.read(job("failed", message="radius: must be known", exception={"status": 400}))
    with pytest.raises(ClientError, match="job j: failed: radius: must be known") as caught:
        successful(failed)
    assert (caught.value.code, caught.value.problem) == (ENDED, {"status": 400})


OUTPUT = Output(
    name="result",
    length=len(CONTENT),
    sha256=hashlib.sha256(CONTENT).hexdigest(),
    media_type="image/tiff",
)


def serving(content: bytes, asked: list[str | None], cuts: list[int | None]) -> Handler:
    """Serve `content` by range; each answer is cut after so many bytes."""

    def handler(request: httpx.Request) -> httpx.Response:
        wanted = request.headers.get("range")
        asked.append(wanted)
        start = int(wanted[6:-1]) if wanted else 0
        cut = cuts.pop(0) if cuts else None
        body = content[start:]
        if cut is None:
            return httpx.Response(206 if start else 200, content=body)
        text = body[:cut]

        class Cut(httpx.SyncByteStream):
            def __iter__(self) -> Iterator[bytes]:
                yield text
                raise httpx.ReadError("broken")

        return httpx.Response(206 if start else 200, stream=Cut())

    return handler


def test_a_download_goes_on_where_it_broke_off(tmp_path: Path) -> None:
    asked: list[str | None] = []
    got: list[int] = []
    target = tmp_path / "out.tif"
    client = answering(serving(CONTENT, asked, [100, 50, None]))
    fetch(client, "j", OUTPUT, target, lambda have, _: got.append(have))
    assert target.read_bytes() == CONTENT
    assert asked == [None, "bytes=100-", "bytes=150-"]
    assert got == [0, 100, 150, len(CONTENT)]
    assert list(tmp_path.iterdir()) == [target]


def test_a_later_download_goes_on_from_what_is_there(tmp_path: Path) -> None:
    asked: list[str | None] = []
    target = tmp_path / "out.tif"
    with pytest.raises(ClientError, match="url: must be a service that answers") as caught:
        fetch(answering(serving(CONTENT, asked, [77]), patience=-1.0), "j", OUTPUT, target)
    assert caught.value.code == AWAY
    assert list(tmp_path.iterdir()) == [part_of(target, OUTPUT)]
    fetch(answering(serving(CONTENT, asked, [])), "j", OUTPUT, target)
    assert asked == [None, "bytes=77-"]
    assert target.read_bytes() == CONTENT
    assert list(tmp_path.iterdir()) == [target]


@pytest.mark.parametrize("there", [b"something else", b"x" * 20_000])
def test_a_part_that_is_something_else_is_dropped(tmp_path: Path, there: bytes) -> None:
    target = tmp_path / "out.tif"
    part_of(target, OUTPUT).write_bytes(there)
    fetch(answering(serving(CONTENT, [], [])), "j", OUTPUT, target)
    assert target.read_bytes() == CONTENT


def test_a_service_that_ignores_ranges_is_read_from_the_start(tmp_path: Path) -> None:
    target = tmp_path / "out.tif"
    part_of(target, OUTPUT).write_bytes(CONTENT[:99])
    fetch(answering(lambda _: httpx.Response(200, content=CONTENT)), "j", OUTPUT, target)
    assert target.read_bytes() == CONTENT


def test_a_download_with_a_wrong_digest_never_appears(tmp_path: Path) -> None:
    wrong = CONTENT[:-1] + b"?"
    with pytest.raises(ClientError, match="does not match its digest"):
        fetch(answering(serving(wrong, [], [])), "j", OUTPUT, tmp_path / "out.tif")
    assert list(tmp_path.iterdir()) == []


def test_credentials_are_for_their_owner_alone(tmp_path: Path) -> None:
    path = tmp_path / "settings" / "credentials.json"
    assert Credentials.load(path).keys == {}
    Credentials("https://a", {"https://a": "secret"}).save(path)
    assert stat.S_IMODE(path.stat().st_mode) == 0o600
    assert [each.name for each in path.parent.iterdir()] == ["credentials.json"]
    assert Credentials.load(path).keys == {"https://a": "secret"}
    path.chmod(0o640)
    with pytest.raises(ClientError, match=r"chmod 600.*mode 640"):
        Credentials.load(path)
    path.chmod(0o600)
    for text in ("{", "[]", json.dumps({"url": "x", "keys": 3})):
        path.write_text(text)
        with pytest.raises(ClientError, match="credentials: must be what"):
            Credentials.load(path)


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
