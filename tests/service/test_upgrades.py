"""A restart with a new release finishes what the old one accepted."""

import hashlib
import shutil
from pathlib import Path

from servers import Server, wait_for

import adret_service

RUNS = "        execute(job_id)\n"
MARKED = '        log.warning("release %s runs %s", "{name}", job_id)\n' + RUNS


def release(folder: Path, name: str) -> str:
    """A copy of the service whose workflow has another source text; returns where it is."""
    source = Path(adret_service.__file__).parent
    ignored = shutil.ignore_patterns("__pycache__")
    shutil.copytree(source, folder / "adret_service", ignore=ignored)
    engine = folder / "adret_service" / "engine" / "durable.py"
    text = engine.read_text("utf-8")
    assert text.count(RUNS) == 1
    engine.write_text(text.replace(RUNS, MARKED.format(name=name)), "utf-8")
    return str(folder)


def test_a_new_release_finishes_the_jobs_of_the_old(example_dem: Path, tmp_path: Path) -> None:
    server = Server(tmp_path / "data", PYTHONPATH=release(tmp_path / "old", "old"))
    try:
        server.start()
        dataset = server.upload(example_dem).json()["id"]
        running = server.submit("sky-view", dataset=dataset, directions=300)
        waiting = [server.submit("shadow", dataset=dataset) for _ in range(2)]
        wait_for(lambda: server.status(running)["progress"] > 0, 60.0, server.log)
        server.kill()
        server.environment["PYTHONPATH"] = release(tmp_path / "new", "new")
        server.start()
        for job in (running, *waiting):
            assert server.wait(job)["status"] == "successful"
        told = server.log.read_text()
        assert f"release old runs {running}" in told
        for job in (running, *waiting):
            assert f"release new runs {job}" in told
            results = server.http.get(f"/jobs/{job}/results").json()
            content = server.http.get(results["result"]["href"]).content
            assert hashlib.sha256(content).hexdigest() == results["result"]["sha256"]
    finally:
        server.stop()
