"""A real server process, a real DEM: what comes back is what the library makes."""

import hashlib
import json
import subprocess
import time
from pathlib import Path

import numpy as np
import pytest
import rasterio
from servers import ADRET, Server, wait_for

import adret
from adret.products import PRODUCTS, run

ORDERS = {
    "horizon": {"directions": 8, "dtype": "float32"},
    "sky-view": {"directions": 8, "kind": "normal"},
    "openness": {"directions": 8, "sign": -1},
    "shadow": {"sun_deg": [315.0, 35.0]},
    "light": {"directions": 8, "sky": "uniform", "sun_deg": [315.0, 35.0]},
    "bounce": {"directions": 4, "sky": "uniform", "bounces": "converge", "tolerance": 0.1},
    "visibility": {"directions": 4, "max_distance": 5000.0},
    "viewshed": {"observer": [[150, 170], [20, 300]], "layer": "count"},
}


@pytest.mark.parametrize("process", ORDERS)
def test_the_result_has_the_bytes_that_the_library_writes(
    process: str, server: Server, dataset: str, example_dem: Path, tmp_path: Path
) -> None:
    job = server.submit(process, dataset=dataset, **ORDERS[process])
    status = server.wait(job)
    assert (status["status"], status["progress"]) == ("successful", 100), status

    results = server.http.get(f"/jobs/{job}/results").json()
    served = server.http.get(results["result"]["href"])
    assert served.headers["content-type"].startswith("image/tiff")
    own = tmp_path / "own.tif"
    product = PRODUCTS[process]
    run(product, adret.Terrain.open(example_dem), product.parameters(**ORDERS[process]), own)
    # Digests: a difference must not have pytest explain megabytes.
    digests = [hashlib.sha256(data).hexdigest() for data in (served.content, own.read_bytes())]
    assert digests[0] == digests[1]

    picture = server.http.get(f"/jobs/{job}/results/preview.png")
    assert picture.content.startswith(b"\x89PNG")
    assert picture.headers["content-type"] == "image/png"


def test_a_result_is_served_by_tag_and_by_range(server: Server, dataset: str) -> None:
    job = server.submit("shadow", dataset=dataset)
    server.wait(job, "successful")
    path = f"/jobs/{job}/results/result"
    whole = server.http.get(path)
    tag, size = whole.headers["etag"], len(whole.content)
    assert tag == f'"{server.http.get(f"/jobs/{job}/results").json()["result"]["sha256"]}"'

    head = server.http.head(path)
    assert (head.status_code, head.content) == (200, b"")
    assert int(head.headers["content-length"]) == size
    assert server.http.get(path, headers={"If-None-Match": tag}).status_code == 304
    assert server.http.get(path, headers={"If-None-Match": '"other"'}).status_code == 200
    assert server.http.get(path, headers={"If-Match": '"other"'}).status_code == 412
    for asked, start, stop in (
        ("bytes=10-19", 10, 20),
        ("bytes=100-", 100, size),
        ("bytes=-7", size - 7, size),
        (f"bytes=5-{10 * size}", 5, size),
        ("bytes=0-", 0, size),
    ):
        part = server.http.get(path, headers={"Range": asked})
        assert part.status_code == 206
        assert part.content == whole.content[start:stop]
        assert part.headers["content-range"] == f"bytes {start}-{stop - 1}/{size}"
    for asked in ("bytes=3-1", "bytes=0-1,5-6", "lines=1-2", "bytes=-"):
        assert server.http.get(path, headers={"Range": asked}).content == whole.content
    stale = {"Range": "bytes=0-9", "If-Range": '"other"'}
    assert server.http.get(path, headers=stale).status_code == 200
    beyond = server.http.get(path, headers={"Range": f"bytes={size}-"})
    assert beyond.status_code == 416
    assert beyond.headers["content-range"] == f"bytes */{size}"


def test_gdal_reads_a_served_result_by_ranges(server: Server, dataset: str) -> None:
    job = server.submit("sky-view", dataset=dataset, directions=4)
    server.wait(job, "successful")
    with rasterio.open(f"/vsicurl/{server.url}/jobs/{job}/results/result") as source:
        assert source.crs.to_epsg() == 2056
        values = source.read(1)
    assert 0.5 < np.nanmean(values) <= 1.0


def test_dismissing_a_running_job_stops_its_work(server: Server, dataset: str) -> None:
    job = server.submit("sky-view", dataset=dataset, directions=7200, method="march")
    wait_for(lambda: server.status(job)["progress"] > 0, 30.0, server.log)
    dismissed = server.http.delete(f"/jobs/{job}")
    assert (dismissed.status_code, dismissed.json()["status"]) == (200, "dismissed")
    took = wait_for(lambda: all(not busy(p) for p in server.children("compute")), 5.0, server.log)
    assert took < 2.0
    missing = server.http.get(f"/jobs/{job}/results")
    assert missing.status_code == 404
    assert missing.json()["type"].endswith("result-not-ready")
    after = server.submit("shadow", dataset=dataset)
    assert server.wait(after)["status"] == "successful"
    assert not list((server.data / "store" / "local" / "jobs").glob(f"{job}*"))
    assert not list((server.data / "tmp").glob(f"*/{job}*"))

    assert server.http.delete(f"/jobs/{job}").status_code == 200
    assert server.http.get(f"/jobs/{job}").status_code == 404


def busy(pid: int) -> bool:
    """Whether a process uses the processor now."""

    def ticks() -> int:
        try:
            fields = Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()
        except (FileNotFoundError, ProcessLookupError):
            return 0
        return int(fields[11]) + int(fields[12])

    before = ticks()
    time.sleep(0.1)
    return ticks() - before > 2


def test_removing_a_finished_job_removes_its_files(server: Server, dataset: str) -> None:
    job = server.submit("shadow", dataset=dataset)
    server.wait(job, "successful")
    folder = server.data / "store" / "local" / "jobs" / job
    assert (folder / "manifest.json").exists()
    assert server.http.delete(f"/jobs/{job}").status_code == 200
    assert not folder.exists()
    assert server.http.get(f"/jobs/{job}/results").status_code == 404


def test_a_job_that_the_terrain_refuses_fails_with_its_reason(
    server: Server, tmp_path: Path
) -> None:
    grid = "ncols 3\nnrows 2\nxllcorner 0\nyllcorner 0\ncellsize 10\n1 2 3\n4 5 6\n"
    (tmp_path / "plain.asc").write_text(grid)
    dataset = server.upload(tmp_path / "plain.asc").json()["id"]
    job = server.submit("sky-view", dataset=dataset, directions=4, curvature=True)
    status = server.wait(job)
    assert status["status"] == "failed"
    answer = server.http.get(f"/jobs/{job}/results")
    assert answer.status_code == 400
    body = answer.json()
    assert body["errors"][0]["field"] in body["detail"]
    assert json.dumps(body).count(str(server.data)) == 0


def test_a_server_refuses_to_listen_to_everyone(tmp_path: Path) -> None:
    command = [str(ADRET), "serve", "--host", "0.0.0.0", "--data-dir", str(tmp_path)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=30)
    assert done.returncode == 2
    assert "host: must be a loopback address" in done.stderr
    assert not list(tmp_path.iterdir())


def test_events_come_while_a_job_runs(server: Server, dataset: str) -> None:
    job = server.submit("sky-view", dataset=dataset, directions=64)
    kinds, progress = [], []
    with server.http.stream("GET", f"/jobs/{job}/events", timeout=60.0) as answer:
        for line in answer.iter_lines():
            if line.startswith("event: "):
                kinds.append(line[7:])
            elif line.startswith("data: ") and kinds[-1] == "progress":
                progress.append(json.loads(line[6:])["progress"])
    assert kinds[0] == "status"
    assert kinds[-2:] == ["status", "end"]
    assert progress == sorted(progress)
    assert server.status(job)["status"] == "successful"


def test_a_dismissed_job_runs_again_with_the_same_result(server: Server, dataset: str) -> None:
    inputs = {"directions": 300, "clip": False}
    job = server.submit("sky-view", dataset=dataset, **inputs)
    server.wait(job, "running")
    server.http.delete(f"/jobs/{job}")
    wait_for(lambda: server.http.post(f"/jobs/{job}/retry").status_code == 201, 10.0)
    assert server.wait(job)["status"] == "successful"
    twin = server.submit("sky-view", dataset=dataset, **inputs)
    server.wait(twin)
    results = [server.http.get(f"/jobs/{each}/results").json()["result"] for each in (job, twin)]
    assert results[0]["sha256"] == results[1]["sha256"]
