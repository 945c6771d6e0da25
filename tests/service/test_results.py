"""Estimates before, STAC items after, and the examples of the API's document."""

import itertools
import json
from pathlib import Path
from typing import Any

import pytest
import rasterio.warp
from servers import Server, write_dem

from adret_service.engine.port import JobRecord, JobStatus
from adret_service.estimate import cost, seconds
from adret_service.examples import DATASET, DEPTH, EXECUTIONS

INFO = {"rows": 200, "columns": 300, "cell_size": [10.0, 10.0]}


def test_an_item_lies_where_the_raster_does(server: Server, dataset: str) -> None:
    job = server.submit("shadow", dataset=dataset)
    server.wait(job, "successful")
    answer = server.http.get(f"/jobs/{job}/stac")
    assert answer.headers["content-type"] == "application/geo+json"
    item = answer.json()
    assert item == server.http.get(f"/jobs/{job}/results/stac").json()
    assert (item["type"], item["stac_version"], item["id"]) == ("Feature", "1.1.0", job)
    assert item["properties"]["proj:code"] == "EPSG:2056"
    source = server.http.get(f"/datasets/{dataset}").json()
    assert item["properties"]["proj:shape"] == [source["rows"], source["columns"]]
    a, b, c, d, e, f = source["transform"]
    assert item["properties"]["proj:transform"] == [a, b, c, d, e, f, 0.0, 0.0, 1.0]

    corners = (c, f + e * source["rows"], c + a * source["columns"], f)
    own = rasterio.warp.transform_bounds("EPSG:2056", "EPSG:4326", *corners, densify_pts=19)
    assert item["bbox"] == pytest.approx(own, abs=1e-5)
    ring = item["geometry"]["coordinates"][0]
    assert ring[0] == ring[-1]
    area = sum(p[0] * q[1] - q[0] * p[1] for p, q in itertools.pairwise(ring))
    assert area > 0.0  # counter-clockwise

    result = item["assets"]["result"]
    assert result["roles"] == ["data"]
    served = server.http.get(result["href"])
    assert result["file:size"] == len(served.content)
    assert result["file:checksum"] == "1220" + served.headers["etag"].strip('"')
    links = {link["rel"]: link["href"] for link in item["links"]}
    assert links["derived_from"].endswith(dataset)
    assert server.http.get(links["self"]).json() == item


def test_an_item_of_a_raster_without_a_crs_lies_nowhere(server: Server, tmp_path: Path) -> None:
    grid = "ncols 3\nnrows 2\nxllcorner 0\nyllcorner 0\ncellsize 10\n1 2 3\n4 5 6\n"
    (tmp_path / "plain.asc").write_text(grid)
    dataset = server.upload(tmp_path / "plain.asc").json()["id"]
    job = server.submit("shadow", dataset=dataset)
    server.wait(job, "successful")
    item = server.http.get(f"/jobs/{job}/stac").json()
    assert item["geometry"] is None
    assert "bbox" not in item


def test_an_unfinished_job_has_no_item(server: Server, dataset: str) -> None:
    job = server.submit("sky-view", dataset=dataset, directions=3600, method="march")
    missing = server.http.get(f"/jobs/{job}/stac")
    assert missing.status_code == 404
    assert missing.json()["type"].endswith("result-not-ready")
    server.http.delete(f"/jobs/{job}")


def test_an_estimate_counts_and_orders_nothing(server: Server, dataset: str) -> None:
    before = server.http.get("/jobs").json()["jobs"]
    order = {"inputs": {"dataset": dataset, "directions": 16}}
    answer = server.http.post("/processes/horizon/estimate", json=order)
    assert answer.status_code == 200, answer.text
    found = answer.json()
    source = server.http.get(f"/datasets/{dataset}").json()
    assert found["cells"] == source["rows"] * source["columns"]
    assert (found["passes"], found["bands"], found["accepted"]) == (16, 16, True)
    time = found["seconds"]
    assert 0.0 < time["low"] <= time["expected"] <= time["high"]
    assert server.http.get("/jobs").json()["jobs"] == before
    wrong = {"inputs": {"dataset": dataset, "directions": 0}}
    refused = server.http.post("/processes/horizon/estimate", json=wrong)
    assert refused.json()["errors"][0]["field"] == "inputs.directions"
    assert server.http.post("/processes/tea/estimate", json=order).status_code == 404


def test_a_cost_grows_with_cells_passes_and_reach() -> None:
    one = cost("horizon", {"directions": 8, "method": "sweep"}, INFO)
    two = cost("horizon", {"directions": 16, "method": "sweep"}, INFO)
    assert (one.cells, one.passes, two.passes) == (60_000, 8, 16)
    assert two.core_seconds > one.core_seconds
    assert two.result_bytes == 2 * one.result_bytes
    march = {"directions": 8, "method": "march"}
    near = cost("horizon", march | {"max_distance": 100.0}, INFO)
    assert near.reach == 10.0
    assert near.core_seconds < cost("horizon", march, INFO).core_seconds
    assert cost("shadow", {"sun_deg": [0, 1]}, INFO).passes == 1
    assert cost("viewshed", {"observer": [[0, 0], [1, 1], [2, 2]]}, INFO).passes == 3
    assert cost("light", {"sky": "none", "directions": 64, "sun_deg": [0, 9]}, INFO).passes == 1
    assert cost("light", {"sky": "uniform", "directions": 64, "sun_deg": [0, 9]}, INFO).passes == 65


def test_a_cost_of_ambient_occlusion_goes_by_method_samples_and_frame() -> None:
    info = {"rows": 800, "columns": 1000, "guard_band": [0, 0, 0, 0], "sky_pixels": 0}
    named = {method: cost("ssao", {"method": method}, info) for method in ("exact", "hbao", "vao")}
    assert [each.passes for each in named.values()] == [32, 36, 8]
    seconds_of = {method: each.core_seconds for method, each in named.items()}
    assert seconds_of["exact"] > 5.0 * seconds_of["hbao"] > 5.0 * seconds_of["vao"]
    order = {"method": "exact", "directions": 8}
    one = cost("ssao", order, info).core_seconds
    assert cost("ssao", order | {"thickness": 0.5}, info).core_seconds > 10.0 * one
    assert cost("ssao", order | {"half_res": True}, info).core_seconds < 0.5 * one
    assert cost("ssao", order, info | {"sky_pixels": 400_000}).core_seconds < 0.8 * one
    inner = info | {"guard_band": [100, 100, 100, 100]}
    assert 0.55 < cost("ssao", order, inner).core_seconds / one < 0.65


def ran(took: float, line: float) -> JobRecord:
    return JobRecord(
        id="",
        tenant="t",
        process="p",
        dataset="",
        inputs={},
        status=JobStatus.SUCCESSFUL,
        started=100.0,
        finished=100.0 + took,
        request={"line": line},
    )


def test_earlier_jobs_correct_an_estimate_and_their_scatter_is_its_range() -> None:
    earlier = [ran(2.0 * line * wobble, line) for line in (1.0, 4.0) for wobble in (0.8, 1.0, 1.25)]
    found = seconds(10.0, 1, earlier)
    assert (found["expected"], found["low"], found["high"]) == (20.0, 16.0, 25.0)
    assert found["jobs"] == 6
    few = seconds(10.0, 1, earlier[:4])
    assert (few["expected"], few["basis"]) == (10.0, "built-in line")


@pytest.mark.parametrize("name", EXECUTIONS)
def test_every_example_of_the_document_is_accepted(
    name: str, server: Server, tmp_path_factory: pytest.TempPathFactory, examples: dict[str, str]
) -> None:
    document = server.http.get("/api").json()
    operation = document["paths"]["/processes/{process_id}/execution"]["post"]
    shown = operation["requestBody"]["content"]["application/json"]["examples"][name]["value"]
    text = json.dumps(shown)
    for placeholder, known in examples.items():
        text = text.replace(placeholder, known)
    answer = server.http.post(f"/processes/{name}/execution", content=text, headers=JSON)
    assert answer.status_code == 201, answer.text
    status = server.wait(answer.json()["jobID"])
    assert status["status"] == "successful", status
    results = server.http.get(f"/jobs/{status['jobID']}/results")
    assert results.status_code == 200
    if shown.get("response") == "raw":
        assert results.content.startswith(b"\x89PNG")


JSON = {"Content-Type": "application/json"}


@pytest.fixture(scope="module")
def examples(server: Server, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """Datasets that stand for those of the examples."""
    import numpy as np
    from servers import hill

    folder = tmp_path_factory.mktemp("examples")
    terrain = server.upload(write_dem(folder / "dem.tif", hill(60, 80))).json()["id"]
    depth = folder / "depth.npy"
    np.save(depth, np.full((24, 32), 5.0, dtype=np.float32))
    camera = json.dumps({"width": 32, "height": 24, "fov_y_deg": 50.0})
    seen = server.upload(depth, camera=camera)
    assert seen.status_code == 201, seen.text
    return {DATASET: terrain, DEPTH: seen.json()["id"]}
