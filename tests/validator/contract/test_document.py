"""Untrusted JSON: bounded, unambiguous, and quick to refuse."""

from __future__ import annotations

import dataclasses
import json
import math
import re
import subprocess
import sys
from typing import Any

import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from tests.each import each
from tests.waiting import PATIENCE_S

from branchdrive.contract.document import dump_json, parse_json
from branchdrive.contract.limits import spec_limits

MAX_BYTES = spec_limits().max_document_bytes
MAX_DEPTH = spec_limits().max_document_depth

HOSTILE: dict[str, bytes] = {
    "empty": b"",
    "white space": b" \n\t ",
    "deep array": b"[" * 100_000,
    "deep closed array": b"[" * 100_000 + b"]" * 100_000,
    "deep object": b'{"a":' * 100_000,
    "deep mixture": b'[{"a":' * 50_000,
    "one level too deep": b"[" * (MAX_DEPTH + 1) + b"]" * (MAX_DEPTH + 1),
    "deep after a string of closing brackets": b'["]]]]]]]]",' + b"[" * MAX_DEPTH + b"]" * MAX_DEPTH + b"]",
    "deep after an escaped quote": b'["\\"",' + b"[" * MAX_DEPTH + b"]" * MAX_DEPTH + b"]",
    "deep after an escaped backslash": b'["\\\\",' + b"[" * MAX_DEPTH + b"]" * MAX_DEPTH + b"]",
    "deep after the document": b"1" + b"[" * 100_000,
    "deep after stray closing brackets": b"]" * 1000 + b"[" * 100_000,
    "NaN": b"NaN",
    "NaN inside": b'{"a": [1, NaN]}',
    "Infinity": b"Infinity",
    "negative Infinity": b'{"a": -Infinity}',
    "float overflow": b"1e999",
    "negative float overflow": b'{"a": -1e999}',
    "integer of 21 digits": b"1" * 21,
    "integer of 5000 digits": b"-" + b"7" * 5000,
    "integer of a million digits": b"9" * 1_000_000,
    "repeated key": b'{"a": 1, "a": 2}',
    "repeated key inside": b'[{"b": {"a": 1, "c": 2, "a": 1}}]',
    "repeated key, other spelling": b'{"a": 1, "\\u0061": 2}',
    "byte order mark": b"\xef\xbb\xbf{}",
    "UTF-16": "{}".encode("utf-16"),
    "invalid UTF-8": b'"\xff"',
    "overlong UTF-8": b'"\xc0\xaf"',
    "truncated UTF-8": b'"\xe2\x82"',
    "surrogate in UTF-8": b'"\xed\xa0\x80"',
    "high surrogate alone": b'"\\ud800"',
    "low surrogate alone": b'"\\uDFFF"',
    "surrogates the wrong way round": b'"\\udc00\\ud800"',
    "surrogate as key": b'{"\\uD800": 1}',
    "surrogate deep inside": b'{"a": [{"b": "x\\udbffx"}]}',
    "half a pair after a whole one": b'"\\ud83d\\ude00\\ud83d"',
    "control character in text": b'"a\nb"',
    "null byte": b"\x00",
    "null byte in text": b'"\x00"',
    "unterminated string": b'"abc',
    "unterminated escape": b'"abc\\',
    "unterminated array": b"[1, 2",
    "invalid escape": b'"\\x41"',
    "escaped line break": b'"a\\\nb"',
    "trailing comma": b"[1,]",
    "trailing text": b"{} {}",
    "single quotes": b"{'a': 1}",
    "comment": b"{} // no",
    "leading zero": b"01",
    "leading plus": b"+1",
    "hexadecimal": b"0x10",
    "bare point": b".5",
    "more than the limit": b'"' + b"a" * 5_000_000 + b'"',
    "more white space than the limit": b" " * 5_000_000 + b"1",
}

LEGAL: dict[str, tuple[bytes, Any]] = {
    "brackets in text": (b'"[[[[{{{{' + b"[" * 1000 + b'"', "[[[[{{{{" + "[" * 1000),
    "brackets in a key": (b'{"' + b"{" * 1000 + b'": 1}', {"{" * 1000: 1}),
    "escaped quote before brackets": (b'"\\"' + b"[" * 1000 + b'"', '"' + "[" * 1000),
    "escaped backslash ends the text": (b'["\\\\", "[[", []]', ["\\", "[[", []]),
    "many escapes": (b'"' + b"\\\\" * 1000 + b"\\" + b'""', "\\" * 1000 + '"'),
    "deepest": (b"[" * MAX_DEPTH + b"]" * MAX_DEPTH, json.loads("[" * MAX_DEPTH + "]" * MAX_DEPTH)),
    "wide": (b"[" + b",".join([b"[]"] * 1000) + b"]", [[]] * 1000),
    "surrogate pair": (b'"\\ud83d\\ude00"', "\U0001f600"),
    "surrogate pair, capitals": (b'"\\uD83D\\uDE00"', "\U0001f600"),
    "text that looks like a surrogate": (b'"\\\\ud800"', "\\ud800"),
    "text beyond ASCII": ('"é\u2028\U0001f600"'.encode(), "é\u2028\U0001f600"),
    "escaped null": (b'"\\u0000"', "\x00"),
    "largest int64": (b"9223372036854775807", 2**63 - 1),
    "smallest int64": (b"-9223372036854775808", -(2**63)),
    "underflow": (b"1e-999", 0.0),
    "same key at other places": (b'{"a": {"a": 1}, "b": {"a": 1}}', {"a": {"a": 1}, "b": {"a": 1}}),
    "white space around": (b" \r\n\t{} \n", {}),
    "null": (b"null", None),
}

PATHOLOGICAL = {
    "backslashes": (b"\\", b""),
    "quotes": (b'"', b""),
    "backslashes in text": (b"\\", b'"'),
    "escaped quotes, open": (b'\\"', b'"'),
    "escaped quotes, closed": (b'\\"', b'["'),
    "escaped line breaks": (b'"a\\\n', b""),
    "open texts": (b'"a', b"["),
    "pairs of brackets": (b"[]", b""),
    "items": (b"[],", b"["),
    "letters": (b"a", b'"'),
    "digits of a fraction": (b"1", b"0."),
    "digits of an exponent": (b"9", b"1e"),
    "surrogates": (b"\\ud800", b'"'),
    "white space": (b" ", b"["),
}
"""Text that is repeated as often as a document may be long, after a beginning."""

MANY_KEYS = 300_000
"""Keys of an object of which one is there twice."""


@each("content", HOSTILE.values(), ids=HOSTILE)
def test_hostile_document_is_a_value_error(content: bytes) -> None:
    with pytest.raises(ValueError) as raised:
        parse_json(content)
    message = str(raised.value)
    assert message.isprintable()
    assert 0 < len(message) < 300


@each(("content", "document"), LEGAL.values(), ids=LEGAL)
def test_legal_document_is_parsed(content: bytes, document: Any) -> None:
    parsed = parse_json(content)
    assert parsed == document
    assert type(parsed) is type(document)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"[NaN]", "NaN is not a JSON number"),
        (b"1e999", "number 1e999 is out of range"),
        (b"1" * 30, "number 1{30} is out of range"),
        (b'{"a": 1, "a": 1}', "object repeats the key 'a'"),
        (b"[" * 65, f"document nests deeper than {MAX_DEPTH} levels"),
        (b" " * (MAX_BYTES + 1), f"document has {MAX_BYTES + 1} bytes; the limit is {MAX_BYTES}"),
        (b'"\\ud800"', "half of a surrogate pair"),
    ],
)
def test_message_says_what_is_wrong(content: bytes, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        parse_json(content)


def test_long_repeated_key_is_shortened() -> None:
    key = json.dumps("\x1b" + "k" * 100_000)
    with pytest.raises(ValueError, match="object repeats the key") as raised:
        parse_json(f"{{{key}: 1, {key}: 2}}".encode())
    assert len(str(raised.value)) < 300
    assert str(raised.value).isprintable()


PARSE = """
import sys
from contextlib import suppress
from branchdrive.contract.document import parse_json
while size := int.from_bytes(sys.stdin.buffer.read(4)):
    with suppress(ValueError):
        parse_json(sys.stdin.buffer.read(size))
"""


def test_the_largest_documents_are_parsed_to_an_end() -> None:
    """With a scan whose time grows with the square of the size they would take days."""
    runs = [start + unit * ((MAX_BYTES - len(start)) // len(unit)) for unit, start in PATHOLOGICAL.values()]
    runs += [b'"' + unit * ((MAX_BYTES - 1) // len(unit)) for unit in (b"\\", b'"', b'\\"')]
    pairs = ",".join(f'"{index}":0' for index in range(MANY_KEYS))
    runs.append(f'{{{pairs},"{MANY_KEYS - 1}":0}}'.encode())
    assert all(len(content) <= MAX_BYTES for content in runs)
    given = b"".join(len(content).to_bytes(4) + content for content in runs) + bytes(4)
    subprocess.run([sys.executable, "-c", PARSE], input=given, check=True, timeout=PATIENCE_S)


json_numbers = st.integers(-(2**63), 2**63 - 1) | st.floats(allow_nan=False, allow_infinity=False)
json_text = st.text(st.sampled_from('[]{}"\\,: a\n/\u2028é\U0001f600'), max_size=12)
json_values = st.recursive(
    st.none() | st.booleans() | json_numbers | json_text,
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(json_text, inner, max_size=3),
    max_leaves=12,
)


def depth(value: Any) -> int:
    match value:
        case dict():
            return 1 + max(map(depth, value.values()), default=0)
        case list():
            return 1 + max(map(depth, value), default=0)
    return 0


@given(json_values)
def test_document_survives_its_own_bytes(document: Any) -> None:
    content = dump_json(document)
    parsed = parse_json(content)
    assert parsed == document
    assert dump_json(parsed) == content


@given(json_values, st.booleans())
def test_depth_is_counted_outside_text_only(document: Any, ensure_ascii: bool) -> None:
    content = json.dumps(document, ensure_ascii=ensure_ascii).encode()
    deepest = depth(document)
    limits = spec_limits()
    assert parse_json(content, dataclasses.replace(limits, max_document_depth=deepest)) == document
    if deepest:
        with pytest.raises(ValueError, match="nests deeper"):
            parse_json(content, dataclasses.replace(limits, max_document_depth=deepest - 1))


json_scraps = st.lists(st.sampled_from([*'[]{}",:\\ue0-1.d8n', "\\ud8", "true"]))


@given(st.binary(max_size=40) | json_scraps.map(lambda scraps: "".join(scraps).encode()))
@example(b'{"a":1,"a":1}')
def test_any_bytes_are_a_value_or_a_value_error(content: bytes) -> None:
    try:
        document = parse_json(content)
    except ValueError:
        return
    assert json.loads(content) == document
    assert parse_json(dump_json(document)) == document


@given(json_values, st.data())
def test_cut_documents_never_pass_for_whole(document: Any, data: st.DataObject) -> None:
    content = dump_json([document]).rstrip()
    end = data.draw(st.integers(0, len(content) - 1))
    with pytest.raises(ValueError, match=r"."):
        parse_json(content[:end])


def test_size_limit_is_inclusive() -> None:
    limits = dataclasses.replace(spec_limits(), max_document_bytes=4)
    assert parse_json(b"1234", limits) == 1234
    with pytest.raises(ValueError, match="document has 5 bytes; the limit is 4"):
        parse_json(b"12345", limits)


def test_canonical_bytes_are_promised() -> None:
    document = {"b": [1, 0.1, True, None], "a": {"é": "\n"}}
    assert dump_json(document) == (
        b'{\n  "a": {\n    "\xc3\xa9": "\\n"\n  },\n  "b": [\n    1,\n    0.1,\n    true,\n    null\n  ]\n}\n'
    )


@given(st.dictionaries(json_text, json_numbers, max_size=5), st.randoms(use_true_random=False))
def test_canonical_bytes_ignore_the_order_of_keys(document: dict[str, Any], random: Any) -> None:
    items = list(document.items())
    random.shuffle(items)
    assert dump_json(dict(items)) == dump_json(document)


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf, "\ud800"], ids=ascii)
def test_what_json_cannot_say_is_not_written(value: Any) -> None:
    with pytest.raises(ValueError, match=re.compile("not JSON compliant|surrogates not allowed")):
        dump_json({"a": value})
