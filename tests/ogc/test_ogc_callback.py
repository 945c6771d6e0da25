"""Requirements class callback: subscribers are told, by signed requests, and nobody else is."""

import hashlib
import hmac
import socket
from collections.abc import Callable
from typing import Any

import pytest
from servers import Server, wait_for

from adret_service.outbound import Blocked, Outbound, checked_address
from ogc.ogc_schemas import RESULTS, STATUS, check, check_exception

Execute = Callable[..., Any]
SECRET = b"a secret of the tests"


def subscriber(receiver: Any, name: str) -> dict[str, str]:
    return {
        kind: receiver.url(f"/{name}/{kind}")
        for kind in ("successUri", "inProgressUri", "failedUri")
    }


def test_job_callback_success(execute: Execute, ogc: Server, receiver: Any) -> None:
    order = {"inputs": {"string": "x", "pause": 1.5}, "subscriber": subscriber(receiver, "a")}
    answer = execute("respond-async", **order)
    assert answer.status_code == 201
    wait_for(lambda: bool(receiver.at("/a/successUri")), 20.0, ogc.log)
    (results,) = receiver.at("/a/successUri")
    check(results, RESULTS)
    assert results == {"string": "x"}
    (progress,) = receiver.at("/a/inProgressUri")
    check(progress, STATUS)
    assert (progress["status"], progress["jobID"]) == ("running", answer.json()["jobID"])
    assert receiver.at("/a/failedUri") == []


def test_job_callback_failed(execute: Execute, ogc: Server, receiver: Any) -> None:
    execute("respond-async", inputs={"fail": True}, subscriber=subscriber(receiver, "b"))
    wait_for(lambda: bool(receiver.at("/b/failedUri")), 20.0, ogc.log)
    (status,) = receiver.at("/b/failedUri")
    check(status, STATUS)
    assert status["status"] == "failed"
    assert receiver.at("/b/successUri") == []


def test_a_callback_is_signed_and_names_its_delivery(
    execute: Execute, ogc: Server, receiver: Any
) -> None:
    order = {"inputs": {"string": "é"}, "subscriber": subscriber(receiver, "c")}
    job = execute("respond-async", **order).json()["jobID"]
    wait_for(lambda: bool(receiver.at("/c/successUri")), 20.0, ogc.log)
    ((headers, body),) = [(h, b) for path, h, b in receiver.got if path == "/c/successUri"]
    fields = dict(part.split("=", 1) for part in headers["Adret-Signature"].split(","))
    signed = hmac.new(SECRET, fields["t"].encode() + b"." + body, hashlib.sha256).hexdigest()
    assert signed == fields["v1"]
    assert headers["Adret-Delivery"] == f"{job}-success"
    assert headers["Content-Type"] == "application/json"


def test_a_callback_is_sent_again_until_it_is_heard(
    execute: Execute, ogc: Server, receiver: Any
) -> None:
    receiver.answers += [500, 503]
    execute(inputs={"string": "x"}, subscriber={"successUri": receiver.url("/d")})
    wait_for(lambda: len(receiver.at("/d")) == 3, 20.0, ogc.log)
    assert (
        len({headers["Adret-Delivery"] for path, headers, _ in receiver.got if path == "/d"}) == 1
    )


def test_a_redirect_is_not_followed_and_a_deaf_subscriber_is_given_up(
    execute: Execute, ogc: Server, receiver: Any
) -> None:
    receiver.answers += [302, 302, 302]
    answer = execute("respond-async", inputs={}, subscriber={"successUri": receiver.url("/e")})
    logs = answer.headers["location"] + "/logs"

    def given_up() -> bool:
        lines = [line["message"] for line in ogc.http.get(logs).json()["logs"]]
        return any("given up after 3: status 302" in line for line in lines)

    wait_for(given_up, 30.0, ogc.log)
    assert len(receiver.at("/e")) == 3
    assert receiver.at("/elsewhere") == []


def test_a_restart_loses_no_callback(execute: Execute, ogc: Server, receiver: Any) -> None:
    order = {"inputs": {"string": "x", "pause": 1}, "subscriber": subscriber(receiver, "f")}
    execute("respond-async", **order)
    ogc.kill()
    ogc.start()
    wait_for(lambda: bool(receiver.at("/f/successUri")), 30.0, ogc.log)


@pytest.mark.parametrize(
    "address",
    [
        "https://elsewhere.example/x",
        "ftp://127.0.0.1/x",
        "http://169.254.169.254/latest",
        "http://user:secret@127.0.0.1/",
        "javascript:alert(1)",
        "http://[::1/",
        "http://127.0.0.1:99999/",
        "",
    ],
)
def test_a_subscriber_elsewhere_is_refused(address: str, execute: Execute) -> None:
    body = check_exception(execute(inputs={}, subscriber={"successUri": address}), 400)
    (error,) = body["errors"]
    assert (error["field"], error["value"]) == ("subscriber.successUri", address)


def test_a_name_that_leads_inside_is_not_connected_to(monkeypatch: pytest.MonkeyPatch) -> None:
    def resolve(host: str, port: int, **_: Any) -> list[Any]:
        addresses = {"both.example": ["93.184.215.14", "10.0.0.7"], "in.example": ["127.0.0.1"]}
        return [(socket.AF_INET, socket.SOCK_STREAM, 6, "", (a, port)) for a in addresses[host]]

    monkeypatch.setattr(socket, "getaddrinfo", resolve)
    for host in ("both.example", "in.example"):
        with pytest.raises(Blocked, match="public"):
            checked_address(host, 443, allow_private=False)
        with pytest.raises(OSError, match="public"):
            Outbound(host).post(f"https://{host}/", b"{}", [])
    assert checked_address("in.example", 80, allow_private=True) == "127.0.0.1"


def test_only_listed_hosts_are_called() -> None:
    outbound = Outbound("Hooks.example.org, *.example.net, odd.example:8443")
    for allowed in (
        "https://hooks.example.org/x?y=1",
        "https://hooks.example.org:443/",
        "https://a.b.example.net/",
        "https://odd.example:8443/",
    ):
        assert outbound.refusal(allowed) is None, allowed
    for refused in (
        "http://hooks.example.org/",
        "https://hooks.example.org:8443/",
        "https://hooks.example.org.evil.example/",
        "https://example.net/",
        "https://evilexample.net/",
        "https://odd.example/",
        "https://hooks.example.org/\r\nX: y",
        "https://hooks.example.org@evil.example/",
    ):
        assert outbound.refusal(refused) is not None, refused
