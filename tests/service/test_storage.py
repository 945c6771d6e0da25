"""The store keeps the same promises in a folder and in a bucket."""

import errno
import hashlib
import os
from pathlib import Path

import pytest

from adret_service.ids import new_id
from adret_service.settings import Settings
from adret_service.storage import FileStorage, Storage, open_storage


@pytest.fixture(params=["folder", "bucket"])
def storage(request: pytest.FixtureRequest, tmp_path: Path) -> Storage:
    options = request.getfixturevalue("bucket") if request.param == "bucket" else {}
    return open_storage(Settings(data_dir=tmp_path / "data", **options))


def publish(storage: Storage, folder: Path, content: bytes, prefix: str) -> str:
    source = folder / "file"
    source.write_bytes(content)
    artefact = storage.publish(source, prefix, "result.tif", "image/tiff")
    assert not source.exists()
    assert (artefact.size, artefact.sha256) == (len(content), hashlib.sha256(content).hexdigest())
    return artefact.key


def test_keys_stay_inside_the_store(storage: Storage, tmp_path: Path) -> None:
    for key in ("../x", "a/../../x", "/etc/passwd", "a//b", "", "a/.b", "a\0b", "A/b"):
        for call in (storage.exists, storage.delete, lambda key: list(storage.read(key))):
            with pytest.raises(ValueError, match="key"):
                call(key)
        with pytest.raises(ValueError, match="key"):
            storage.local(key, tmp_path)


def test_an_artefact_is_named_by_its_content_and_read_by_range(
    storage: Storage, tmp_path: Path
) -> None:
    prefix = f"t/jobs/{new_id()}"
    key = publish(storage, tmp_path, b"0123456789", prefix)
    assert key == f"{prefix}/84d89877f0d4041e-result.tif"
    assert b"".join(storage.read(key, 2, 5)) == b"234"
    assert b"".join(storage.read(key, 7, 99)) == b"789"
    assert b"".join(storage.read(key)) == b"0123456789"
    assert storage.local(key, tmp_path).read_bytes() == b"0123456789"
    storage.delete(prefix)
    assert not storage.exists(key)
    assert publish(storage, tmp_path, b"0123456789", prefix) == key
    assert publish(storage, tmp_path, b"0123456789", prefix) == key  # a run that is repeated


def test_a_large_artefact_comes_back_whole(storage: Storage, tmp_path: Path) -> None:
    content = os.urandom((20 << 20) + 17)
    key = publish(storage, tmp_path, content, f"t/jobs/{new_id()}")
    assert b"".join(storage.read(key)) == content
    first, last = (8 << 20) - 3, (16 << 20) + 5
    assert b"".join(storage.read(key, first, last)) == content[first:last]
    assert storage.local(key, tmp_path).read_bytes() == content


def test_what_has_no_manifest_has_no_artefacts(storage: Storage, tmp_path: Path) -> None:
    prefix = f"t/jobs/{new_id()}"
    source = tmp_path / "file"
    source.write_bytes(b"x")
    artefact = storage.publish(source, prefix, "result.tif", "image/tiff")
    assert storage.manifest(prefix) is None
    storage.write_manifest(prefix, {"result": artefact}, {"why": "test"})
    assert storage.manifest(prefix) == {"result": artefact}
    storage.delete(prefix)
    assert storage.manifest(prefix) is None
    storage.delete(prefix)


def test_prefixes_tell_what_is_in_the_store(storage: Storage, tmp_path: Path) -> None:
    job = f"t/jobs/{new_id()}"
    publish(storage, tmp_path, b"x", job)
    dataset = f"t/datasets/{new_id()}"
    publish(storage, tmp_path, b"y", dataset)
    ages = dict(storage.prefixes("jobs"))
    assert -2.0 < ages[job] < 60.0
    assert dataset not in ages
    assert dataset in dict(storage.prefixes("datasets"))


def test_a_manifest_that_cannot_be_written_leaves_none(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    storage = FileStorage(tmp_path / "store")

    def full(*_: object) -> None:
        raise OSError(errno.ENOSPC, "no space left")

    monkeypatch.setattr("adret_service.storage._sync", full)
    with pytest.raises(OSError, match="no space"):
        storage.write_manifest("t/jobs/j", {}, {})
    assert storage.manifest("t/jobs/j") is None
    assert list(storage.path("t/jobs/j").iterdir()) == []


@pytest.mark.parametrize("url", ["file:///x", "http://x/y", "s3://", "gs://b"])
def test_a_store_elsewhere_is_refused(url: str) -> None:
    with pytest.raises(ValueError, match="storage_url"):
        Settings(storage_url=url)
