"""Drawing is quiet, and leaves everything else as loud as it was."""

from __future__ import annotations

import logging
import warnings

import numpy as np
import pytest

from branchdrive_reference.plotting import quiet


def test_remarks_of_numpy_and_the_plotting_library_are_not_heard(caplog: pytest.LogCaptureFixture) -> None:
    with quiet():
        warnings.warn("a glyph is missing", UserWarning, stacklevel=1)
        assert np.isneginf(np.log(np.zeros(1))).all()
        logging.getLogger("matplotlib.axes").warning("a place is not finite")
    assert caplog.records == []


def test_afterwards_they_are_heard_again(caplog: pytest.LogCaptureFixture) -> None:
    with pytest.raises(KeyError), quiet():
        raise KeyError
    with pytest.warns(UserWarning, match="a glyph"):
        warnings.warn("a glyph is missing", UserWarning, stacklevel=1)
    with pytest.warns(RuntimeWarning, match="divide by zero"):
        np.log(np.zeros(1))
    logging.getLogger("matplotlib.axes").warning("a place is not finite")
    assert len(caplog.records) == 1
