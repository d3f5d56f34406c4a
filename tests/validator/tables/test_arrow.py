"""A stored frame reads the columns that are asked for, and gives what reading all of them gives."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from tests.model_release import make_frames

from branchdrive.tables import arrow
from branchdrive.tables.arrow import StoredFrame, from_arrow, to_arrow


def test_a_column_is_read_once_and_when_it_is_asked_for(monkeypatch: pytest.MonkeyPatch) -> None:
    table = to_arrow("state", make_frames()["state"])
    expected, frame, read = from_arrow(table, "state"), StoredFrame(table, "state"), arrow._values
    times: list[int] = []

    def counted(chunked: Any, nullable: bool) -> Any:
        times.append(len(chunked))
        return read(chunked, nullable)

    monkeypatch.setattr(arrow, "_values", counted)
    assert [*frame] == [*expected]
    assert times == []
    for _ in range(2):
        np.testing.assert_array_equal(frame["group_id"], expected["group_id"])
    assert times == [len(table)]
    for name, values in frame.items():
        np.testing.assert_array_equal(np.ma.getdata(values), np.ma.getdata(expected[name]))
        np.testing.assert_array_equal(np.ma.getmaskarray(values), np.ma.getmaskarray(expected[name]))
        with pytest.raises(ValueError, match="read-only"):
            np.ma.getdata(values)[:0] = values[:0]
    assert len(times) == len(expected)
