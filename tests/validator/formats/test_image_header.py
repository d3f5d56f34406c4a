"""`image_header` and `decode_image`: what images are, and which bytes are none."""

from __future__ import annotations

import struct
import sys
from io import BytesIO

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image
from tests.validator.formats.image_files import jpeg, noise, png

from branchdrive.contract.camera import PinholeCamera, TopDownCamera
from branchdrive.contract.limits import spec_limits
from branchdrive.errors import DecodeError, PlatformError
from branchdrive.formats.image_codec import can_decode, decode_image
from branchdrive.formats.image_header import ImageHeader, disagreement, image_header, read_header

RGB, GREY = noise(1, 9, 16, 3), noise(2, 9, 16)

FRONT = PinholeCamera(
    name="front", stream="rgb_surround", width_px=16, height_px=9, fx_px=8.0, fy_px=8.0, cx_px=8.0, cy_px=4.5,
    x_m=0.0, y_m=0.0, z_m=1.0, yaw_rad=0.0, pitch_rad=0.0,
)  # fmt: skip
BEV = TopDownCamera(
    name="bev", stream="semantic_bev", width_px=16, height_px=9, px_per_m=2.0, origin_row_px=4.0, origin_column_px=8.0
)


def saved(mode: str, form: str = "PNG", **options: object) -> bytes:
    stream = BytesIO()
    Image.fromarray(RGB).convert(mode).save(stream, form, **options)
    return stream.getvalue()


@pytest.mark.parametrize(
    ("image", "header"),
    [
        (png(RGB), ImageHeader("png", 16, 9, "rgb", 8)),
        (png(GREY), ImageHeader("png", 16, 9, "grey", 8)),
        (saved("P"), ImageHeader("png", 16, 9, "palette", 8)),
        (saved("RGBA"), ImageHeader("png", 16, 9, "rgb with alpha", 8)),
        (saved("LA"), ImageHeader("png", 16, 9, "grey with alpha", 8)),
        (saved("I;16"), ImageHeader("png", 16, 9, "grey", 16)),
        (jpeg(RGB), ImageHeader("jpeg", 16, 9, "rgb", 8)),
        (jpeg(RGB, progressive=True), ImageHeader("jpeg", 16, 9, "rgb", 8)),
        (jpeg(RGB, comment=b"\xff\xd9" * 40), ImageHeader("jpeg", 16, 9, "rgb", 8)),
        (jpeg(GREY), ImageHeader("jpeg", 16, 9, "grey", 8)),
        (saved("CMYK", "JPEG"), ImageHeader("jpeg", 16, 9, "cmyk", 8)),
    ],
    ids=["rgb", "grey", "palette", "rgba", "la", "deep", "jpeg", "progressive", "comment", "grey jpeg", "cmyk"],
)
def test_header_says_what_an_image_is(image: bytes, header: ImageHeader) -> None:
    assert read_header(image) == header


@pytest.mark.parametrize(
    "bytes_",
    [
        *(b"", b"GIF89a", bytes(64), png(RGB)[:40], jpeg(RGB)[:-9], b"\xff\xd8", b"\xff\xd8\xff\xd9", b"\xff" * 99),
        *(b"\xff\xd8\xff\xe0\x00\x00" * 9, b"\xff\xd8" + b"\xff\xe0\x00\x04ab" * 3),
    ],
)
def test_other_bytes_are_no_image(bytes_: bytes) -> None:
    with pytest.raises(DecodeError):
        image_header(bytes_)


def test_scans_are_counted_before_anything_is_decoded() -> None:
    image = jpeg(RGB, progressive=True)
    scan = image[image.rindex(b"\xff\xda") : -2]
    most = spec_limits().max_image_scans
    allowed = most - image.count(b"\xff\xda")
    assert decode_image(image[:-2] + scan * allowed + image[-2:]).shape == (9, 16, 3)
    with pytest.raises(DecodeError, match=f"{most + 1} markers of a scan; expected a JPEG of at most {most} scans"):
        decode_image(image[:-2] + scan * (allowed + 1) + image[-2:])


def test_a_transparent_colour_is_refused_as_decoders_differ_on_it() -> None:
    with pytest.raises(DecodeError, match="expected a PNG without transparency"):
        decode_image(saved("RGB", transparency=(1, 2, 3)))
    assert (decode_image(png(RGB, note=b"tRNS")) == RGB).all()


def test_a_jpeg_that_lost_its_data_but_kept_its_end_decodes_to_something() -> None:
    image = jpeg(noise(3, 64, 64, 3))
    assert decode_image(image[: len(image) // 2] + image[-2:]).shape == (64, 64, 3)


@given(st.binary(max_size=60), st.sampled_from([b"", b"\xff\xd8", png(RGB)[:8], png(RGB)[:16], jpeg(RGB)[:30]]))
def test_any_bytes_have_a_header_or_a_plain_error(rest: bytes, start: bytes) -> None:
    for read in (image_header, decode_image):
        try:
            read(start + rest)
        except DecodeError as error:
            assert str(error)


@pytest.mark.parametrize("pixels", [RGB, GREY], ids=["rgb", "grey"])
def test_pixels_of_a_png_are_read_back(pixels: np.ndarray) -> None:
    assert (decode_image(png(pixels)) == pixels).all()


def test_pixels_of_a_jpeg_are_nearly_read_back() -> None:
    smooth = np.broadcast_to(np.arange(0, 160, 10, np.uint8)[:, None], (9, 16, 3))
    decoded = decode_image(jpeg(np.ascontiguousarray(smooth), quality=95))
    assert decoded.shape == (9, 16, 3)
    assert np.abs(decoded.astype(int) - smooth).max() < 8


@pytest.mark.parametrize("image", [saved("P"), saved("RGBA"), saved("CMYK", "JPEG"), png(RGB)[:50] + png(RGB)[-12:]])
def test_what_no_dataset_may_hold_is_not_decoded(image: bytes) -> None:
    with pytest.raises(DecodeError):
        decode_image(image)


def test_without_a_library_the_error_names_the_extra(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("PIL", "cv2"):
        monkeypatch.setitem(sys.modules, name, None)
    assert not can_decode()
    with pytest.raises(PlatformError, match="the extra `media` brings"):
        decode_image(png(RGB))


@pytest.mark.parametrize(
    ("camera", "image", "expected"),
    [
        (FRONT, png(RGB), None),
        (FRONT, jpeg(RGB), None),
        (FRONT, png(GREY), "three channels of 8 bits"),
        (FRONT, png(RGB[:, :8]), "16 x 9 pixels, as camera `front` is declared"),
        (BEV, png(GREY), None),
        (BEV, png(RGB), "a PNG of one channel of 8 bits"),
        (BEV, jpeg(GREY), "a PNG of one channel of 8 bits"),
        (BEV, png(GREY[:1]), "16 x 9 pixels, as camera `bev` is declared"),
    ],
)
def test_an_image_is_of_the_size_and_kind_of_its_camera(
    camera: PinholeCamera | TopDownCamera, image: bytes, expected: str | None
) -> None:
    assert disagreement(image_header(image), camera) == expected


def test_a_size_of_many_pixels_is_read_without_decoding_them() -> None:
    image = bytearray(png(RGB))
    image[16:24] = struct.pack(">II", 2**31 - 1, 2**31 - 1)
    assert read_header(bytes(image)).width_px == 2**31 - 1
    with pytest.raises(DecodeError):
        decode_image(bytes(image))
