from __future__ import annotations

import pytest
from tests.each import each

from branchdrive.contract.machine_trace import trace_of


@each(
    ("text", "trace"),
    [
        pytest.param(text, trace, id=text)
        for trace, texts in {
            "an absolute path": [
                "/srv/ada/x", "from /mnt/a", "~/runs", "root='/data/x'", "file:///etc/hosts", "C:\\runs", "d:/runs",
                "\\\\server\\share",
            ],
            "a host": ["ada@gpu17", "ssh root@node-3:/x", "localhost:2000", "10.0.0.7:2000"],
            "a time on the clock": [
                "2026-03-01T12:30", "2026-03-01 12:30:00", "run-20260301-123000", "run_20260301t123000",
                "20260301123000", "g1-2026-01-15t14.22.33", "g1-2026-01-15t14-22-33", "run of 2026-01-15_14.22",
            ],
        }.items()
        for text in texts
    ],
)  # fmt: skip
def test_traces_are_found(text: str, trace: str) -> None:
    assert trace_of(text) == trace


@each(
    "text",
    [
        "", "nominal of planned group 0, collection seed 7", "CARLA 0.9.15", "10.0.0.7", "5 km/h", "and/or", "a / b",
        "maps/Town10/route", "/", "/streams", "https://example.org/a/b", "ada@example.org", "2026-03-01", "12:30",
        "2026-03-01-7", "g-2026-03-01-12-300",
        ":J0_0_0", "-E12_0", "123#1_0", "Town04_Route12", "('>', '>>', 0)", "seed 20260399123000", "1:200", "@ 20 Hz",
        "123456789012345678",
        "a20260301123000f", "3f20260301123000", "20260301-1230-4a5b",
    ],
)  # fmt: skip
def test_other_texts_have_none(text: str) -> None:
    assert trace_of(text) is None
