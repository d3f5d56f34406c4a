"""`find_flaw`: images that decoders may disagree on are refused before one of them is asked; notes are left out."""

from __future__ import annotations

import struct
import sys
import zlib
from io import BytesIO

import numpy as np
import pytest
from PIL import Image, ImageOps
from tests.each import each
from tests.validator.formats.image_files import jpeg, noise, png

from branchdrive.errors import DecodeError
from branchdrive.formats.image_codec import decode_image
from branchdrive.formats.image_header import image_header, read_header
from branchdrive.formats.image_parts import find_flaw

PNG, JPEG = png(noise(1, 4, 8, 3)), jpeg(noise(2, 32, 32, 3))
HEAD, SCAN = PNG[:8], JPEG.index(b"\xff\xda")
ROWS = zlib.decompress(PNG[41:-16])


def _chunk(kind: bytes, body: bytes) -> bytes:
    return struct.pack(">I", len(body)) + kind + body + zlib.crc32(kind + body).to_bytes(4, "big")


def _with(*chunks: bytes) -> bytes:
    """The PNG with more chunks behind its header."""
    return PNG[:33] + b"".join(chunks) + PNG[33:]


def _with_data(data: bytes) -> bytes:
    return PNG[:33] + _chunk(b"IDAT", data) + PNG[-12:]


TEXT = _chunk(b"tEXt", b"a\0b")

OF_FORM = {
    "unknown critical chunk": _with(_chunk(b"ABCD", b"")),
    "second header": _with(_chunk(b"IHDR", PNG[16:29])),
    "palette": _with(_chunk(b"PLTE", bytes(6))),
    "animation": _with(_chunk(b"acTL", bytes(8))),
    "data that are apart": _with(_chunk(b"IDAT", b""), TEXT),
    "many chunks": _with(TEXT * 20_000),
    "many segments": JPEG[:2] + JPEG[2:SCAN] + b"\xff\xfe\x00\x02" * 20_000 + JPEG[SCAN:],
}

XMP = b'<x:xmpmeta xmlns:x="adobe:ns:meta/"><a tiff:Orientation="6"/></x:xmpmeta>'


def _turned(form: str, **options: object) -> bytes:
    """The pixels of a PNG with a note on how they are to be turned, as Pillow writes it."""
    stream = BytesIO()
    Image.open(BytesIO(PNG)).save(stream, form, **options)
    return stream.getvalue()


def _segment(marker: bytes, body: bytes) -> bytes:
    return b"\xff" + marker + struct.pack(">H", len(body) + 2) + body


def _exif(orientation: int) -> bytes:
    exif = Image.Exif()
    exif[0x0112] = orientation
    return exif.tobytes()


def _raw_profile(name: bytes) -> bytes:
    exif = _exif(6)
    return _chunk(b"zTXt", name + b"\0\0" + zlib.compress(b"\nexif\n%8d\n%s\n" % (len(exif), exif.hex().encode())))


TURNED = {
    **{f"jpeg turned by {number}": _turned("JPEG", exif=_exif(number)) for number in range(2, 9)},
    **{f"png turned by {number}": _turned("PNG", exif=_exif(number)) for number in range(2, 9)},
    "jpeg turned by XMP": JPEG[:2] + _segment(b"\xe1", b"http://ns.adobe.com/xap/1.0/\0" + XMP) + JPEG[2:],
    "png turned by a profile": _with(_raw_profile(b"Raw profile type exif")),
    "png turned by XMP": _with(_chunk(b"iTXt", b"XML:com.adobe.xmp\0\0\0\0\0" + XMP)),
    "png turned by a text": _with(_chunk(b"tEXt", b"exif\0" + _exif(6))),
}

DAMAGED = {
    "cut": PNG[:-14],
    "bit flipped": PNG[:50] + bytes([PNG[50] ^ 1]) + PNG[51:],
    "no data": PNG[:33] + PNG[-12:],
    "another behind it": PNG + PNG,
    "jpeg cut": JPEG[:-40],
    "jpeg without a scan": JPEG[:SCAN] + JPEG[-2:],
    "jpeg without data of its scan": JPEG[: SCAN + 14] + JPEG[-2:],
    "jpeg without tables": JPEG[: JPEG.index(b"\xff\xc4")] + JPEG[SCAN:],
    "jpeg of two frames": JPEG[:SCAN] + JPEG[JPEG.index(b"\xff\xc0") : JPEG.index(b"\xff\xc4")] + JPEG[SCAN:],
    "jpeg with another behind it": JPEG + JPEG,
    "jpeg with an archive behind it": JPEG + b"PK\x03\x04" + bytes(40) + JPEG[-2:],
    "jpeg with a gap": JPEG[:SCAN] + b"gap" + JPEG[SCAN:],
}


@pytest.mark.parametrize("name", OF_FORM)
def test_another_form_is_told_from_damage(name: str) -> None:
    flaw = find_flaw(OF_FORM[name], read_header(OF_FORM[name]).encoding)
    assert flaw is not None
    assert flaw.is_of_form


@each("name", TURNED)
def test_an_image_that_some_readers_turn_is_refused(name: str) -> None:
    image = TURNED[name]
    with Image.open(BytesIO(image)) as opened:
        is_turned = np.asarray(ImageOps.exif_transpose(opened)).tobytes() != np.asarray(opened).tobytes()
    assert is_turned or name == "jpeg turned by XMP"  # which readers turn depends on their version
    flaw = find_flaw(image, read_header(image).encoding)
    assert flaw is not None
    assert flaw.is_of_form
    with pytest.raises(DecodeError, match="EXIF and XMP"):
        image_header(image)


@pytest.mark.parametrize("name", DAMAGED)
def test_damage_is_seen_without_decoding(name: str) -> None:
    flaw = find_flaw(DAMAGED[name], read_header(DAMAGED[name]).encoding)
    assert flaw is not None
    assert not flaw.is_of_form


@pytest.mark.parametrize(
    ("image", "found"),
    [
        (PNG + b"more", "4 bytes behind `IEND`"),
        (PNG[:-20], "one that is cut short"),
        (JPEG + b"more", "4 bytes behind its end marker"),
        (JPEG[:-1], "one that is cut short"),
        (JPEG[:SCAN] + b"gap" + JPEG[SCAN:], f"no whole segment at byte {SCAN}"),
    ],
)
def test_what_is_found_says_where_an_image_goes_wrong(image: bytes, found: str) -> None:
    flaw = find_flaw(image, read_header(image).encoding)
    assert flaw is not None
    assert flaw.found == found


@pytest.mark.parametrize(
    ("image", "text"),
    [
        (_with_data(zlib.compress(ROWS) + b"more"), "4 bytes behind its rows"),
        (_with_data(zlib.compress(ROWS[:-1])), "fewer rows than its header says"),
        (_with_data(zlib.compress(ROWS + b"\0")), "more rows than its header says"),
        (_with_data(zlib.compress(ROWS)[:-1] + b"?"), "cannot be unpacked"),
        (HEAD + _chunk(b"IHDR", PNG[16:26] + b"\x07\0\0") + PNG[33:], "unknown methods"),
    ],
)
def test_rows_of_a_png_are_those_of_its_header_and_nothing_else(image: bytes, text: str) -> None:
    with pytest.raises(DecodeError, match=text):
        decode_image(image)


NOTES = {
    "packed text": _with(_chunk(b"zTXt", b"note\0\0" + zlib.compress(bytes(5_000_000)))),
    "packed profile": _with(_chunk(b"iCCP", b"note\0\0" + zlib.compress(bytes(5_000_000)))),
    "text behind the pixels": PNG[:-12] + _chunk(b"iTXt", b"note") + PNG[-12:],
    "broken profile": JPEG[:2] + b"\xff\xe2\x00\x10ICC_PROFILE\0\1\1" + JPEG[2:],
    "comment": JPEG[:2] + b"\xff\xfe\x00\x06\xff\xd9\xff\xd9" + JPEG[2:],
    "fill": JPEG[:2] + b"\xff" * 9 + JPEG[2:] + bytes(3),
}


@pytest.mark.parametrize("missing", ["PIL", "cv2"])
@pytest.mark.parametrize("name", NOTES)
def test_notes_keep_no_library_from_decoding(name: str, missing: str, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("cv2" if missing == "PIL" else "PIL.Image")
    image = NOTES[name]
    monkeypatch.setitem(sys.modules, missing, None)
    assert find_flaw(image, image_header(image).encoding) is None
    assert (decode_image(image) == decode_image(PNG if image.startswith(HEAD) else JPEG)).all()
