"""Requests that a stranger might send: huge, nested, lying about themselves.

`REQUESTS` maps a name to (method, path, headers, body, status, field) and `LINES` to (pieces, pause
between them [s], status that the answer begins with), for what no client library would send.
"""

import json
from typing import Any

from adret_service.ids import new_id

JSON = {"Content-Type": "application/json"}
FORM = {"Content-Type": "multipart/form-data; boundary=b"}
TUS = {"Tus-Resumable": "1.0.0"}
ORDER = "/processes/horizon/execution"
ID = new_id()

Request = tuple[str, str, dict[str, str], bytes | None, int, str | None]


def order(**inputs: Any) -> bytes:
    return json.dumps({"inputs": {"dataset": ID, **inputs}}).encode()


REQUESTS: dict[str, Request] = {
    "no JSON": ("POST", ORDER, JSON, b"{", 400, "body"),
    "JSON nested 100 000 times": ("POST", ORDER, JSON, b"[" * 100_000, 400, "body"),
    "JSON of 2 MiB": ("POST", ORDER, JSON, b'"' + b"a" * (2 << 20) + b'"', 413, "body"),
    "bytes that are no text": ("POST", ORDER, JSON, b'{"inputs": "\xff\xfe"}', 400, "body"),
    "an input that there is none of": (
        "POST",
        ORDER,
        JSON,
        order(path="/etc/passwd"),
        400,
        "inputs.path",
    ),
    "a number of 400 digits": (
        "POST",
        ORDER,
        JSON,
        order(directions=10**400),
        400,
        "inputs.directions",
    ),
    "NaN": ("POST", ORDER, JSON, order(max_distance=float("nan")), 400, "inputs.max_distance"),
    "a dataset that is a path": (
        "POST",
        ORDER,
        JSON,
        order(dataset="../../x"),
        400,
        "inputs.dataset",
    ),
    "a dataset that is an address": (
        "POST",
        ORDER,
        JSON,
        order(dataset="http://127.0.0.1/"),
        400,
        "inputs.dataset",
    ),
    "a dataset that there is none of": ("POST", ORDER, JSON, order(), 400, "inputs.dataset"),
    "a process that is a path": ("GET", "/processes/..%2f..%2fetc%2fpasswd", {}, None, 404, None),
    "a dataset's path upwards": ("GET", "/datasets/../../etc/passwd", {}, None, 404, None),
    "a dataset's id with a byte of zero": ("GET", "/datasets/%00", {}, None, 404, None),
    "a job's id of 4 kB": ("GET", "/jobs/" + "a" * 4096, {}, None, 404, None),
    "a result that is a path": (
        "GET",
        f"/jobs/{ID}/results/..%2f..%2fadret.db",
        {},
        None,
        404,
        None,
    ),
    "a page of 10^9": ("GET", "/datasets?limit=1000000000", {}, None, 400, "limit"),
    "a page before a quote": (
        "GET",
        "/jobs?before=%27%20or%201=1--aaaaaaaaaaaaaaaaaaaaaaaaa",
        {},
        None,
        400,
        "before",
    ),
    "a state that is a query": (
        "GET",
        "/jobs?status=%27;drop%20table%20adret_jobs",
        {},
        None,
        400,
        "status.0",
    ),
    "another method": ("PUT", "/datasets", {}, b"", 405, None),
    "another site's form": (
        "POST",
        "/uploads",
        {"Origin": "http://evil.example"},
        b"x",
        403,
        "origin",
    ),
    "another host's name": ("GET", "/datasets", {"Host": "evil.example"}, None, 400, None),
    "a form without a boundary": (
        "POST",
        "/uploads",
        {"Content-Type": "multipart/form-data"},
        b"x",
        400,
        "content-type",
    ),
    "a form that is none": ("POST", "/uploads", FORM, b"no boundary at all", 400, "body"),
    "a form cut off": (
        "POST",
        "/uploads",
        FORM,
        b'--b\r\nContent-Disposition: form-data; name="file"\r\n\r\nabc',
        400,
        "body",
    ),
    "a form of another field": (
        "POST",
        "/uploads",
        FORM,
        b'--b\r\nContent-Disposition: form-data; name="other"\r\n\r\nabc\r\n--b--\r\n',
        400,
        "other",
    ),
    "a form of endless headers": (
        "POST",
        "/uploads",
        FORM,
        b"--b\r\nX-Long: " + b"a" * 20_000 + b"\r\n\r\nabc\r\n--b--\r\n",
        400,
        "body",
    ),
    "an upload's option that there is none of": (
        "POST",
        "/uploads?path=/etc/passwd",
        {},
        b"x",
        400,
        "path",
    ),
    "a camera of 9 kB": ("POST", "/uploads?camera=" + "a" * 9000, {}, b"x", 400, "camera"),
    "a resumable upload of 10^15 bytes": (
        "POST",
        "/uploads/tus",
        TUS | {"Upload-Length": str(10**15)},
        b"",
        413,
        "Upload-Length",
    ),
    "a resumable upload of no length": ("POST", "/uploads/tus", TUS, b"", 400, "Upload-Length"),
    "a resumable upload of another version": (
        "POST",
        "/uploads/tus",
        {"Upload-Length": "9"},
        b"",
        412,
        "Tus-Resumable",
    ),
    "a piece for nobody's upload": (
        "PATCH",
        f"/uploads/tus/{ID}",
        TUS | {"Upload-Offset": "0", "Content-Type": "application/offset+octet-stream"},
        b"x",
        404,
        None,
    ),
    "a tile of nobody's": ("GET", f"/datasets/{ID}/tiles/0/0/0.png", {}, None, 404, None),
    "a tile at zoom 10^9": ("GET", f"/datasets/{ID}/tiles/1000000000/0/0.png", {}, None, 404, None),
    "a horizon of NaN": ("GET", f"/datasets/{ID}/horizon?lat=nan&lon=0", {}, None, 400, "lat"),
    "an idempotency key of 9 kB": (
        "POST",
        ORDER,
        JSON | {"Idempotency-Key": "k" * 9000},
        order(),
        400,
        "Idempotency-Key",
    ),
}

HEAD = b"POST /uploads HTTP/1.1\r\nHost: localhost\r\n"

LINES: dict[str, tuple[list[bytes], float, bytes]] = {
    "an upload that stops": ([HEAD + b"Content-Length: 1000\r\n\r\nII*\0"], 0.0, b"408"),
    "an upload in drops": ([HEAD + b"Content-Length: 99999\r\n\r\n", *[b"I"] * 10], 0.3, b"408"),
    "a negative length": ([HEAD + b"Content-Length: -1\r\n\r\nabc"], 0.0, b"400"),
    "a length in words": ([HEAD + b"Content-Length: many\r\n\r\nabc"], 0.0, b"400"),
    "two lengths": ([HEAD + b"Content-Length: 3\r\nContent-Length: 4\r\n\r\nabcd"], 0.0, b"400"),
    "a length of 10^20": ([HEAD + b"Content-Length: 1" + b"0" * 20 + b"\r\n\r\nabc"], 0.0, b"4"),
    "a chunk of another length": (
        [HEAD + b"Transfer-Encoding: chunked\r\n\r\nzz\r\nabc\r\n"],
        0.0,
        b"400",
    ),
    "a header of 100 kB": (
        [b"GET / HTTP/1.1\r\nHost: localhost\r\nX: " + b"a" * 100_000],
        0.0,
        b"4",
    ),
    "a head of 100 kB in one piece": (
        [b"GET / HTTP/1.1\r\nHost: localhost\r\n" + b"X: y\r\n" * 17_000 + b"\r\n"],
        0.0,
        b"4",
    ),
    "an address of 100 kB": ([b"GET /" + b"a" * 100_000 + b" HTTP/1.1\r\n\r\n"], 0.0, b"4"),
    "a chunk whose size has no end": (
        [HEAD + b"Transfer-Encoding: chunked\r\n\r\n1;" + b"a" * 100_000],
        0.0,
        b"4",
    ),
    "no HTTP": ([b"\x16\x03\x01\x02\x00\x01\x00\r\n\r\n"], 0.0, b"400"),
    "a header in two": (
        [b"GET / HTTP/1.1\r\nHost: localhost\r\n X: y\r\nBad Name: 1\r\n\r\n"],
        0.0,
        b"400",
    ),
}
