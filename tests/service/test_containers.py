"""The container files: what they must say, and that their commands work without a container."""

import os
import re
import shlex
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
import yaml
from servers import Server, wait_for

from adret_service.settings import Settings

ROOT = Path(__file__).resolve().parents[2]
FOLDER = ROOT / "docker"
COMPOSED = sorted(FOLDER.glob("compose*.yaml"))
PINNED = re.compile(r"[\w./-]+:(?=[\w.-]*\d)[\w.-]+")


def instructions() -> list[tuple[str, str]]:
    """The Dockerfile's instructions, continued lines joined."""
    text = re.sub(r"\\\n\s*", "", (FOLDER / "Dockerfile").read_text("utf-8"))
    lines = [line for line in text.splitlines() if line.strip() and not line.startswith("#")]
    return [(line.split(None, 1)[0], line.split(None, 1)[1]) for line in lines]


def after_last_from() -> list[tuple[str, str]]:
    listed = instructions()
    last = max(i for i, (word, _) in enumerate(listed) if word == "FROM")
    return listed[last:]


def test_the_image_has_two_stages_on_one_pinned_python() -> None:
    stages = [rest.split()[0] for word, rest in instructions() if word == "FROM"]
    assert len(stages) == 2
    assert len(set(stages)) == 1
    assert re.fullmatch(r"python:3\.12\.\d+-slim-\w+", stages[0])
    installs = [rest for word, rest in instructions() if "pip install" in rest]
    assert all("-c constraints.txt" in each for each in installs)
    assert len(installs) == 1


def test_the_image_runs_as_nobody_special_with_its_kernels_compiled_and_its_health_known() -> None:
    stage = after_last_from()
    words = [word for word, _ in stage]
    user = words.index("USER")
    assert stage[user][1] not in ("root", "0")
    assert words.index("CMD") > user
    made = next(rest for word, rest in stage if "useradd" in rest)
    uid = re.search(r"--uid (\d+)", made)
    assert uid is not None
    assert int(uid[1]) >= 10_000
    warm = next(i for i, (_, rest) in enumerate(stage) if rest.startswith("python /opt/adret/warm"))
    assert warm > user, "kernels that root compiled cannot be replaced"
    assert "HEALTHCHECK" in words
    assert "ADD" not in words
    assert "rm -rf /var/lib/apt/lists/*" in next(rest for _, rest in stage if "apt-get" in rest)


def test_everything_that_is_copied_is_there_and_not_ignored() -> None:
    ignored = set((ROOT / ".dockerignore").read_text("utf-8").split())
    for word, rest in instructions():
        if word == "COPY" and "--from" not in rest:
            for source in rest.split()[:-1]:
                assert (ROOT / source).exists(), source
                assert source.split("/")[0] not in ignored


def test_no_secret_is_in_a_file() -> None:
    for path in FOLDER.iterdir():
        for line in path.read_text("utf-8").splitlines():
            if re.search(r"(PASSWORD|SECRET)\w*:\s", line):
                assert "${" in line, line


@pytest.mark.parametrize("path", COMPOSED, ids=lambda path: path.name)
def test_compositions_are_closed_and_pinned(path: Path) -> None:
    composed: dict[str, Any] = yaml.safe_load(path.read_text("utf-8"))
    volumes = set(composed["volumes"])
    used = set()
    for name, service in composed["services"].items():
        assert PINNED.fullmatch(service["image"]), service["image"]
        assert "latest" not in service["image"]
        assert not service.get("privileged", False)
        for port in service.get("ports", []):
            assert port.startswith("127.0.0.1:"), port
        for volume in service.get("volumes", []):
            if ":" in volume:
                used.add(volume.split(":")[0])
        assert set(service.get("depends_on", {})) <= set(composed["services"])
        if "build" in service:
            assert (path.parent / service["build"]["context"]).resolve() == ROOT
            assert service["read_only"]
            assert service["cap_drop"] == ["ALL"]
            assert "no-new-privileges:true" in service["security_opt"]
            mounts = [each.split(":")[-1] for each in service["volumes"]] + service["tmpfs"]
            assert {"/data", "/kernels", "/tmp"} <= set(mounts), name
        for key in service.get("environment", {}):
            if key.startswith("ADRET_"):
                assert key.removeprefix("ADRET_").lower() in Settings.model_fields, key
    assert used == volumes


def test_many_machines_ask_for_keys_and_share_what_they_must() -> None:
    composed = yaml.safe_load((FOLDER / "compose.many.yaml").read_text("utf-8"))
    api, worker = (composed["services"][name] for name in ("api", "worker"))
    assert api["environment"]["ADRET_AUTH"] == "apikey"
    for name in ("ADRET_DATABASE_URL", "ADRET_STORAGE_URL", "ADRET_STORAGE_ENDPOINT"):
        assert api["environment"][name] == worker["environment"][name]
    assert "ports" not in worker


@pytest.mark.slow
def test_the_commands_of_the_image_work_in_a_clean_environment(
    tmp_path: Path, example_dem: Path
) -> None:
    """Install, warm up and serve as the Dockerfile does, with its paths moved."""
    listed = instructions()
    runs = [rest for word, rest in listed if word == "RUN"]
    venv, kernels = tmp_path / "adret", tmp_path / "kernels"
    kernels.mkdir()
    environment = {
        "PATH": f"{venv}/bin:/usr/bin:/bin",
        "HOME": str(tmp_path),
        "NUMBA_CACHE_DIR": str(kernels),
    }
    make = next(each for each in runs if "-m venv" in each)
    install = next(each for each in runs if "pip install" in each)
    warm = next(each for each in runs if "warm.py" in each)
    assert make == "python -m venv /opt/adret"
    subprocess.run([sys.executable, "-m", "venv", str(venv)], check=True, timeout=120)
    words = shlex.split(install.replace("/opt/adret", str(venv)))
    known = {k: v for k, v in os.environ.items() if k.startswith("PIP_") or k.endswith("_proxy")}
    subprocess.run(words, cwd=ROOT, env={**known, **environment}, check=True, timeout=600)
    words = shlex.split(warm.replace("/opt/adret/warm.py", str(FOLDER / "warm.py")))
    words[0] = str(venv / "bin" / "python")
    subprocess.run(words, cwd=tmp_path, env=environment, check=True, timeout=900)
    assert list(kernels.iterdir())
    command = next(rest for word, rest in listed if word == "CMD")
    assert command == '["adret", "serve", "--host", "0.0.0.0", "--port", "8000"]'
    server = Server(tmp_path / "data", program=venv / "bin" / "adret", **environment)
    try:
        server.start()
        dataset = server.upload(example_dem).json()["id"]
        job = server.submit("shadow", dataset=dataset)
        wait_for(lambda: server.status(job)["status"] == "successful", 60.0, server.log)
    finally:
        server.stop()
