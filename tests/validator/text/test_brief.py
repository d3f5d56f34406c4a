"""Numbers that people read are short, and never look equal where they are not."""

from __future__ import annotations

import pytest

from branchdrive.text.brief import brief


@pytest.mark.parametrize(
    ("texts", "shown"),
    [
        (("2.469306740359309", "7.63276681000072"), ("2.469307", "7.632767")),
        (("-33.43825486784858", "unavailable"), ("-33.43825", "unavailable")),
        (("steer 0.020998787, brake 0.3",), ("steer 0.02099879, brake 0.3",)),
        (("1000.0", "0.98 to 1.02"), ("1000.0", "0.98 to 1.02")),
        (("0.30000001192092896", "0.30000000000000004"), ("0.30000001192092896", "0.30000000000000004")),
        (("12345678.901234", "1.2345678901e-05"), ("12345678.901234", "1.2345678901e-05")),
        (("g0.brake_0.123456789.a1", "version 1.2.345678901"), ("g0.brake_0.123456789.a1", "version 1.2.345678901")),
    ],
)
def test_long_numbers_are_rounded_unless_they_would_look_equal(texts: tuple[str, ...], shown: tuple[str, ...]) -> None:
    assert brief(*texts) == shown
