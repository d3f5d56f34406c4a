"""Values of the semantic bird's-eye view."""

from __future__ import annotations

import numpy as np

from branchdrive.contract.semantic_bev import (
    CHANNEL_MEANING,
    CLASS_MEANING,
    SemanticChannel,
    SemanticClass,
    channels_of,
    classes_of,
)


def test_every_value_is_a_class_and_four_channels() -> None:
    values = np.arange(256, dtype=np.uint8).reshape(16, 16)
    assert (classes_of(values) == np.arange(16)).all()
    assert channels_of(values).shape == (16, 16, 4)
    bits = channels_of(values) @ np.array([channel.value for channel in SemanticChannel])
    assert (bits + classes_of(values) == values).all()


def test_channels_and_classes_share_no_bit_and_have_meanings() -> None:
    assert all(kind.value < min(SemanticChannel).value for kind in SemanticClass)
    assert sum(SemanticChannel) == 0b11110000
    assert (list(CLASS_MEANING), list(CHANNEL_MEANING)) == (list(SemanticClass), list(SemanticChannel))


def test_an_ego_on_the_route() -> None:
    pixel = np.uint8(SemanticClass.VEHICLE | SemanticChannel.EGO | SemanticChannel.REMAINING_ROUTE)
    assert classes_of(np.array(pixel)) == SemanticClass.VEHICLE
    assert channels_of(np.array(pixel)).tolist() == [True, False, False, True]
