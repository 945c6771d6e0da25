"""Work in progress has a bound of its own."""

from pathlib import Path

from servers import AppClient, wait_for

from adret_service.app import create_app
from adret_service.engine.memory import MemoryEngine
from adret_service.prefer import preferences
from adret_service.scratch import scratch_bytes
from adret_service.settings import Settings


def test_nothing_new_is_taken_while_too_much_is_in_progress(tmp_path: Path) -> None:
    settings = Settings(data_dir=tmp_path / "data", min_free_bytes=0, scratch_max_bytes=1000)
    with AppClient(create_app(settings, MemoryEngine())) as client:
        assert client.post("/uploads", content=b"x").status_code == 415
        left = settings.scratch_dir / "worker-x" / "job"
        left.mkdir(parents=True)
        (left / "result.tif").write_bytes(bytes(1001))
        wait_for(lambda: client.post("/uploads", content=b"x").status_code == 507, 5.0)
        answer = client.post("/uploads", content=b"x")
        assert "work in progress: must be at most 1000 bytes" in answer.json()["detail"]
        assert int(answer.headers["retry-after"]) > 0
        (left / "result.tif").unlink()
        wait_for(lambda: client.post("/uploads", content=b"x").status_code == 415, 5.0)
    assert scratch_bytes(tmp_path / "nowhere") == 0


def test_preferences_are_read_as_the_rfc_has_them() -> None:
    assert preferences(["respond-async "]) == {"respond-async": ""}
    assert preferences(['Respond-Async, WAIT="5"']) == {"respond-async": "", "wait": "5"}
    assert preferences(["wait=5;q=1, ,=x, wait=9"]) == {"wait": "5"}
    assert preferences([]) == {}
