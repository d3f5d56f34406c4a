"""The kernel cache is emptied exactly when a source has changed."""

from __future__ import annotations

from pathlib import Path

from branchdrive_reference.kernel_cache import drop_stale_kernels


def test_cache_is_emptied_when_a_source_changes(tmp_path: Path) -> None:
    source, cached = tmp_path / "a.py", tmp_path / "sub" / "__pycache__" / "f.nbi"
    source.write_text("x = 1\n")
    cached.parent.mkdir(parents=True)
    cached.touch()
    assert drop_stale_kernels(tmp_path)
    assert not cached.exists()

    cached.touch()
    assert not drop_stale_kernels(tmp_path)
    assert cached.exists()

    source.write_text("x = 2\n")
    assert drop_stale_kernels(tmp_path)
    assert not cached.exists()
