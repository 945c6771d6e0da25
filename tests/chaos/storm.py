"""Storms: jobs keep coming while what runs them is killed, and an account of their fate."""

import hashlib
import json
import os
import random
import signal
import threading
import time
from collections import Counter
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import httpx
from servers import Server, descendants, gone, wait_for

from adret_service.client.errors import ClientError
from adret_service.client.session import Client

# From a tenth of a second to a second or two on one thread.
ORDERS: list[tuple[str, dict[str, Any]]] = [
    ("sky-view", {"directions": 64}),
    ("horizon", {"directions": 8}),
    ("sky-view", {"directions": 200, "clip": False}),
    ("shadow", {"sun_deg": [315.0, 35.0]}),
    ("light", {"directions": 24, "sky": "uniform", "sun_deg": [315.0, 35.0]}),
]
ENDS = ("successful", "failed", "dismissed")


@dataclass
class Orders:
    """Jobs that clients order, each once, by clients that ask again until they are answered."""

    server: Server
    dem: Path
    count: int
    accepted: dict[str, int] = field(default_factory=dict)  # order number by the job's id
    expected: dict[int, str] = field(default_factory=dict)  # digest of the result by kind of order
    dataset: str = ""
    failure: BaseException | None = None
    _allowed: threading.Semaphore = field(default_factory=lambda: threading.Semaphore(0))

    def prepare(self) -> None:
        """Have each kind of order done in peace, which gives the bytes that are right."""
        with Client(self.server.url) as client:
            self.dataset = client.upload(self.dem).id
            for kind, (process, inputs) in enumerate(ORDERS):
                job = client.submit(process, {"dataset": self.dataset, **inputs})
                assert self.server.wait(job.id)["status"] == "successful"
                self.expected[kind] = client.results(job.id)["result"].sha256

    def start(self) -> threading.Thread:
        """Order in the background, as far as `allow` lets it."""
        thread = threading.Thread(target=self._order, daemon=True)
        thread.start()
        return thread

    def allow(self, share: float) -> None:
        """Let so large a share of the orders out."""
        for _ in range(round(share * self.count)):
            self._allowed.release()

    def _order(self) -> None:
        try:
            with Client(self.server.url, patience=300.0) as client:
                client.jobs(limit=1)
                for number in range(self.count):
                    self._allowed.acquire()
                    process, inputs = ORDERS[number % len(ORDERS)]
                    ordered = {"dataset": self.dataset, **inputs}
                    job = client.submit(process, ordered, f"storm-{number}")
                    self.accepted[job.id] = number
        except BaseException as error:
            self.failure = error

    def wait_for_all(self, seconds: float) -> None:
        """Wait until every accepted job has ended."""
        left = set(self.accepted)

        def ended() -> bool:
            with suppress(httpx.TransportError, KeyError, ValueError):
                for each in list(left):
                    if self.server.status(each)["status"] in ENDS:
                        left.discard(each)
            return not left

        wait_for(ended, seconds, self.server.log)

    def account(self) -> dict[str, Any]:
        """Look at every job, every event and every stored file, and count what is wrong."""
        if self.failure is not None:
            raise self.failure
        http = self.server.http
        statuses: Counter[str] = Counter()
        twice = runs = wrong = 0
        for job, number in self.accepted.items():
            answer = http.get(f"/jobs/{job}")
            status = answer.json()["status"] if answer.status_code == 200 else "lost"
            statuses[status] += 1
            told = [line.get("status") for line in http.get(f"/jobs/{job}/logs").json()["logs"]]
            runs += told.count("running")
            twice += sum(each in ENDS for each in told) > 1
            if status == "successful":
                result = http.get(f"/jobs/{job}/results/result")
                found = hashlib.sha256(result.content).hexdigest()
                wrong += found != self.expected[number % len(ORDERS)]
        listed = http.get("/jobs", params={"limit": 1000}).json()["jobs"]
        return {
            "jobs": self.count,
            "accepted": len(self.accepted),
            "lost": statuses["lost"],
            "not_successful": self.count - statuses["successful"],
            "ended_twice": twice,
            "made_twice": len(listed) - len(ORDERS) - self.count,
            "corrupt": wrong + len(half_files(self.server.data / "store")),
            "left_over": len(left_over(self.server.data)),
            "runs_repeated": runs - self.count,
        }


def half_files(store: Path) -> list[Path]:
    """Files of the store that no manifest names, or that are not what their name says."""
    bad = []
    named: set[Path] = set()
    for manifest in store.glob("*/jobs/*/manifest.json"):
        for artefact in json.loads(manifest.read_text())["artefacts"].values():
            path = store / artefact["key"]
            named.add(path)
            if hashlib.sha256(path.read_bytes()).hexdigest() != artefact["sha256"]:
                bad.append(path)
    for path in store.glob("*/jobs/*/*"):
        if path.name != "manifest.json" and path not in named:
            bad.append(path)
    return bad


def left_over(data: Path) -> list[Path]:
    """Work in progress in the scratch folders."""
    return [path for path in (data / "tmp").glob("*/*") if not path.name.startswith("upload-")]


def kill_at_random(
    orders: Orders, kills: int, seed: int, log: Callable[[str], None] = lambda _: None
) -> Counter[str]:
    """Kill computing processes, workers, the server, or all at once, while jobs run."""
    server, random_ = orders.server, random.Random(seed)
    done: Counter[str] = Counter()
    kinds = ["compute", "worker", "server", "everything"]
    weights = [25, 45, 15, 15]
    while done.total() < kills:
        orders.allow(1.0 / kills)
        wait_for(lambda: something_runs(server), 120.0, server.log)
        time.sleep(random_.uniform(0.0, 1.0))
        kind = random_.choices(kinds, weights)[0]
        if done.total() < len(kinds):
            kind = kinds[done.total()]  # each at least once
        if kill(server, kind, random_):
            done[kind] += 1
            log(f"{done.total()} {kind}")
    return done


def something_runs(server: Server) -> bool:
    """Whether a job runs now."""
    with suppress(httpx.TransportError, ValueError, KeyError):
        answer = server.http.get("/jobs", params={"status": "running", "limit": 1})
        return answer.status_code == 200 and bool(answer.json()["jobs"])
    return False


def kill(server: Server, kind: str, random_: random.Random) -> bool:
    """Kill -9 one process, or all; a server that was killed is started again."""
    assert server.process is not None
    if kind in ("compute", "worker"):
        found = server.children(f"adret_service.{kind}")
        if not found:
            return False
        with suppress(ProcessLookupError):
            os.kill(random_.choice(found), signal.SIGKILL)
        return True
    everyone = descendants(server.process.pid)
    server.kill()
    if kind == "everything":
        for pid in everyone:
            with suppress(ProcessLookupError):
                os.kill(pid, signal.SIGKILL)
    wait_for(lambda: all(map(gone, everyone)), 30.0, server.log)
    server.start(ready=False)
    return True


def kill_storm(
    server: Server,
    dem: Path,
    *,
    jobs: int,
    kills: int,
    seed: int = 1,
    log: Callable[[str], None] = lambda _: None,
) -> dict[str, Any]:
    """Kill -9 in the middle of the work, until every accepted job has ended; the account."""
    orders = Orders(server, dem, jobs)
    orders.prepare()
    began = time.monotonic()
    ordering = orders.start()
    killed = kill_at_random(orders, kills, seed, log)
    orders.allow(1.0)  # rounding may have kept some back
    ordering.join(300.0)
    orders.wait_for_all(600.0)
    took = time.monotonic() - began
    wait_for(lambda: left_over(server.data) == [], 30.0, server.log)
    return {"kills": killed.total(), **killed, **orders.account(), "seconds": round(took, 1)}


WRONG = ("lost", "not_successful", "ended_twice", "made_twice", "corrupt", "left_over")


def nothing_wrong(account: dict[str, Any]) -> bool:
    """Whether every accepted job ended once, with the right bytes, and nothing is left over."""
    return account["accepted"] == account["jobs"] and not any(account[name] for name in WRONG)


def try_again(call: Callable[[], Any]) -> bool:
    """Whether a call of the service works now."""
    try:
        call()
    except (ClientError, httpx.TransportError):
        return False
    return True
