"""The client's commands as a person types them, against a real server."""

import json
import os
import re
import signal
import stat
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
import rasterio
from servers import ADRET, Server, wait_for

Adret = Callable[..., "subprocess.CompletedProcess[str]"]


@pytest.fixture
def home(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A person's folder of settings."""
    return tmp_path_factory.mktemp("home")


@pytest.fixture
def environment(server: Server, home: Path) -> dict[str, str]:
    known = {name: value for name, value in os.environ.items() if not name.startswith("ADRET_")}
    return {**known, "XDG_CONFIG_HOME": str(home), "ADRET_URL": server.url}


@pytest.fixture
def adret(environment: dict[str, str], tmp_path: Path) -> Adret:
    """Run a command in an empty folder."""

    def run(*words: object, **options: Any) -> "subprocess.CompletedProcess[str]":
        return subprocess.run(
            [str(ADRET), *map(str, words)],
            **{"env": environment, "cwd": tmp_path, "timeout": 60, **options},
            capture_output=True,
            text=True,
        )

    return run


def test_run_does_the_whole_round(adret: Adret, example_dem: Path, tmp_path: Path) -> None:
    words = ["run", "light", example_dem, "--directions", 8, "-i", "sun_deg=[315,35]"]
    words += ["--out", "out.tif", "--preview", "out.png"]
    done = adret(*words)
    assert done.returncode == 0, done.stderr
    with rasterio.open(tmp_path / "out.tif") as source:
        assert source.crs.to_epsg() == 2056
    assert (tmp_path / "out.png").read_bytes().startswith(b"\x89PNG")
    assert sorted(p.name for p in tmp_path.iterdir()) == ["out.png", "out.tif"]
    again = adret(*words)
    assert again.returncode == 2
    assert "out: must be a new file" in again.stderr


def test_each_step_has_its_command_and_its_json(
    adret: Adret, server: Server, example_dem: Path, tmp_path: Path
) -> None:
    dataset = adret("upload", example_dem).stdout.strip()
    document = json.loads(adret("upload", example_dem, "--json").stdout)
    assert document["id"] == dataset
    job = adret("run", "shadow", dataset, "--detach").stdout.strip()
    told = [json.loads(line) for line in adret("watch", job, "--json").stdout.splitlines()]
    assert [each["event"] for each in told[:-1]][-2:] == ["status", "end"]
    assert told[-1]["status"] == "successful"
    numbers = [each["id"] for each in told[:-2]]
    assert numbers == sorted(set(numbers))
    listed = json.loads(adret("jobs", "--json", "--limit", 3, "--process", "shadow").stdout)
    assert listed["jobs"][0]["jobID"] == job
    assert json.loads(adret("jobs", job).stdout)["status"] == "successful"
    assert job in adret("jobs").stdout
    assert adret("watch", job).stdout == "successful\n"
    assert adret("cancel", job).stdout == f"{job} successful\n"
    fetched = json.loads(adret("fetch", job, "--json").stdout)
    file = tmp_path / f"{job}-result.tif"
    assert (fetched["path"], fetched["bytes"]) == (file.name, file.stat().st_size)
    assert adret("fetch", job, "preview", "--out", "p.png").stdout == "p.png\n"
    assert sorted(p.name for p in tmp_path.iterdir()) == [file.name, "p.png"]
    assert server.status(job)["status"] == "successful"


def test_a_refusal_is_one_line_and_a_code(
    adret: Adret, server: Server, dataset: str, tmp_path: Path
) -> None:
    refused: list[tuple[int, str, list[object]]] = [
        (2, "inputs.directions: must be", ["run", "horizon", dataset, "--directions", 0, "-d"]),
        (2, "no such process: 'none'", ["run", "none", dataset, "-d"]),
        (2, "inputs.dataset: must be", ["run", "shadow", "0" * 26, "-d"]),
        (2, "file: must be an existing file", ["run", "shadow", "missing.tif", "-d"]),
        (2, "out: must be given, or --detach", ["run", "shadow", dataset]),
        (2, "out: must be given, or --detach", ["run", "shadow", dataset, "-d", "-o", "x.tif"]),
        (2, "input: must be name=value", ["run", "shadow", dataset, "-d", "-i", "x"]),
        (2, "no such job: '000000", ["watch", "0" * 26]),
        (2, "no such job", ["fetch", "0" * 26]),
        (2, "id: must be letters", ["cancel", "../x"]),
        (1, "url: must be a service that answers", ["jobs", "--url", "http://127.0.0.1:1"]),
        (2, "url: must begin with", ["jobs", "--url", "here"]),
    ]
    for code, text, words in refused:
        done = adret(*words)
        assert (done.returncode, done.stdout) == (code, ""), done.stderr
        assert done.stderr.startswith("adret: "), words
        assert text in done.stderr, words
        assert done.stderr.count("\n") == 1
    assert not list(tmp_path.iterdir())
    done = adret("run", "horizon", dataset, "-i", "directions=0", "-i", "x=1", "--json", "-d")
    problem = json.loads(done.stderr)["error"]["problem"]
    assert sorted(each["field"] for each in problem["errors"]) == ["inputs.directions", "inputs.x"]


def test_interrupting_run_dismisses_its_job_and_interrupting_watch_does_not(
    server: Server, environment: dict[str, str], adret: Adret, dataset: str, tmp_path: Path
) -> None:
    known = {job["jobID"] for job in server.http.get("/jobs").json()["jobs"]}
    words = ["run", "sky-view", dataset, "--directions", 7200, "-i", "method=march", "-o", "o.tif"]
    client = start(words, environment, tmp_path)

    def new_jobs() -> list[dict[str, str]]:
        return [j for j in server.http.get("/jobs").json()["jobs"] if j["jobID"] not in known]

    wait_for(lambda: any(job["status"] == "running" for job in new_jobs()), 30.0, server.log)
    job = new_jobs()[0]["jobID"]
    watcher = start(["watch", job, "--json"], environment, tmp_path)
    assert watcher.stdout is not None
    assert json.loads(watcher.stdout.readline())["event"] == "status"
    watcher.send_signal(signal.SIGINT)
    watcher.communicate(timeout=20)
    assert watcher.returncode == 130
    assert server.status(job)["status"] == "running"
    client.send_signal(signal.SIGINT)
    client.communicate(timeout=20)
    assert client.returncode == 130
    assert [each["status"] for each in new_jobs()] == ["dismissed"]
    assert not list(tmp_path.iterdir())
    done = adret("watch", job)
    assert (done.returncode, done.stdout) == (3, "dismissed\n")
    assert f"job {job}: dismissed" in done.stderr


def start(words: list[Any], environment: dict[str, str], folder: Path) -> "subprocess.Popen[bytes]":
    pipe = subprocess.PIPE
    command = [str(ADRET), *map(str, words)]
    return subprocess.Popen(command, env=environment, cwd=folder, stdout=pipe, stderr=pipe)


@pytest.fixture
def guarded(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Server]:
    """An API that asks for keys, and no worker."""
    folder = tmp_path_factory.mktemp("guarded") / "data"
    server = Server(folder, ADRET_AUTH="apikey", ADRET_ROLE="api")
    try:
        server.start(ready=False)
        yield server
    finally:
        server.stop()


def test_a_login_keeps_a_key_that_the_service_knows(
    guarded: Server, adret: Adret, environment: dict[str, str], home: Path
) -> None:
    made = adret("keys", "--tenant", "alice", "--data-dir", guarded.data).stdout.split()
    del environment["ADRET_URL"]
    nobody = adret("jobs", "--url", guarded.url)
    assert (nobody.returncode, "adret login" in nobody.stderr) == (2, True)
    wrong = adret("login", guarded.url, input="adret_wrong\n")
    assert (wrong.returncode, list(home.iterdir())) == (2, [])
    right = adret("login", guarded.url, input=made[1] + "\n")
    assert right.returncode == 0, right.stderr
    assert made[1] not in right.stdout + right.stderr
    file = home / "adret" / "credentials.json"
    assert stat.S_IMODE(file.stat().st_mode) == 0o600
    assert json.loads(adret("jobs", "--json").stdout) == {"jobs": []}
    assert adret("login", guarded.url, "--remove").returncode == 0
    assert adret("jobs").returncode == 2
    environment["ADRET_API_KEY"] = made[1]
    assert adret("jobs").returncode == 0


def test_run_outlasts_a_server_that_is_killed(
    tmp_path_factory: pytest.TempPathFactory,
    environment: dict[str, str],
    example_dem: Path,
    tmp_path: Path,
) -> None:
    server = Server(tmp_path_factory.mktemp("restarted") / "data")
    try:
        server.start()
        environment = {**environment, "ADRET_URL": server.url}
        words = ["run", "sky-view", example_dem, "--directions", 300, "-i", "method=sweep"]
        client = start([*words, "-o", "out.tif"], environment, tmp_path)
        wait_for(lambda: server.http.get("/jobs").json()["jobs"] != [], 30.0, server.log)
        job = server.http.get("/jobs").json()["jobs"][0]["jobID"]
        server.wait(job, "running")
        server.kill()
        server.start()
        _, told = client.communicate(timeout=60)
        assert client.returncode == 0, told
        with rasterio.open(tmp_path / "out.tif") as source:
            assert source.count == 1
    finally:
        server.stop()


def test_the_guide_runs_as_it_stands(environment: dict[str, str], tmp_path: Path) -> None:
    root = Path(__file__).resolve().parents[2]
    page = (root / "docs/how-to/use-a-service-from-the-shell.md").read_text("utf-8")
    script = "set -eu\n" + "\n".join(re.findall(r"```sh\n(.*?)```", page, flags=re.DOTALL))
    (tmp_path / "examples").symlink_to(root / "examples")
    path = f"{ADRET.parent}{os.pathsep}{environment['PATH']}"
    done = subprocess.run(
        ["sh", "-c", script], env={**environment, "PATH": path}, cwd=tmp_path, timeout=100
    )
    assert done.returncode == 0
    made = {"lit.tif", "lit.png", "sky.tif", "sky.png"}
    assert made < {file.name for file in tmp_path.iterdir()}


def test_help_is_there_before_anything_heavy() -> None:
    code = (
        "import sys; from adret.cli import main; main(['--help']); "
        "print(sorted({'numpy', 'numba', 'httpx', 'pydantic', 'rich.progress', 'fastapi', "
        "'sqlalchemy'} & set(sys.modules)))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.stdout.splitlines()[-1] == "[]"
