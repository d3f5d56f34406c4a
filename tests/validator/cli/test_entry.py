"""Entry points, before the commands are loaded."""

from __future__ import annotations

import sys
from collections.abc import Callable

import pytest

import branchdrive.cli.main  # noqa: F401  the module whose loading is interrupted
from branchdrive.cli import entry as entry_points


@pytest.mark.parametrize(
    ("point", "prog"), [(entry_points.main, "branchdrive"), (entry_points.validate_main, "branchdrive-validate")]
)
def test_an_interrupt_while_the_commands_are_loaded_is_one_line(
    point: Callable[[], int], prog: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    class Interrupts:
        def find_spec(self, name: str, *_: object) -> None:
            if name == "branchdrive.cli.main":
                raise KeyboardInterrupt

    monkeypatch.delattr("branchdrive.cli.main")
    monkeypatch.delitem(sys.modules, "branchdrive.cli.main")
    monkeypatch.setattr(sys, "meta_path", [Interrupts(), *sys.meta_path])
    assert point() == 130
    assert capsys.readouterr() == ("", f"{prog}: interrupted\n")
