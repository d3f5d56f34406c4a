"""Defects and limits of archives of images, and of how many rows name the same bytes."""

from __future__ import annotations

import hashlib

import numpy as np
from tests.archives import FOREIGN, HOSTILE, Images, Writer, plain
from tests.synthetic import BRANCH_TICK, STRIDE
from tests.validator.engine.rules.case import BRAKE, NOMINAL, SHARD_0, Edit, boundary, mutant
from tests.validator.engine.rules.cases.images import COLOURS
from tests.validator.engine.rules.cases.media import replace_image, unseen
from tests.validator.engine.rules.draft import Draft

from branchdrive.contract.limits import spec_limits
from branchdrive.formats.media_archive import member_name
from branchdrive.testing.media import png

ARCHIVE = "views.tar"


TICKS = (BRANCH_TICK - STRIDE, BRANCH_TICK, BRANCH_TICK + STRIDE)


def archive_images(d: Draft, write: Writer, attempts: tuple[str, ...] = (NOMINAL,)) -> None:
    """Move three images of a camera of attempts into an archive that `write` makes of them."""
    keys = [(attempt, tick) for attempt in attempts for tick in TICKS]
    images: Images = [
        (member_name(attempt, tick, "rear", "png"), unseen(number)) for number, (attempt, tick) in enumerate(keys)
    ]
    content, offsets = write(images)
    for (attempt, tick), offset, (_, image) in zip(keys, offsets, images, strict=True):
        row = {"file": ARCHIVE, "offset_bytes": offset, "size_bytes": len(image)}
        row["checksum"] = hashlib.sha256(image).hexdigest()[:16]
        for column, value in row.items():
            d.set("frames", column, value, rollout_id=attempt, camera="rear", tick=tick)
    d.before_seal(lambda root: (root / SHARD_0 / ARCHIVE).write_bytes(content))


def _written(write: Writer) -> Edit:
    """The images in an archive of a kind."""

    def edit(d: Draft) -> None:
        archive_images(d, write)

    return edit


# BD-FRM-013

SEVERAL = {"one name for all": 2, "images in another order": 2}
"""Kinds with several findings."""


for kind, writer in HOSTILE.items():
    mutant(
        "BD-FRM-013",
        base="media",
        at={"file": f"{SHARD_0}/{ARCHIVE}"},
        findings=SEVERAL.get(kind, 1),
        name=kind.replace(" ", "_").lower(),
    )(_written(writer))


@mutant("BD-FRM-013", base="media", at={"file": f"{SHARD_0}/{ARCHIVE}", "rollout_id": NOMINAL}, findings=4)
def attempts_in_turns(d: Draft) -> None:
    archive_images(d, lambda images: _in_turns(images, 3), (NOMINAL, BRAKE))


def _in_turns(images: Images, step: int) -> tuple[bytes, list[int]]:
    order = [place for first in range(step) for place in range(first, len(images), step)]
    content, offsets = plain([images[place] for place in order])
    return content, [offsets[order.index(place)] for place in range(len(images))]


@mutant("BD-FRM-013", findings=2, base="media", at={"file": f"{SHARD_0}/{ARCHIVE}", "rollout_id": BRAKE})
def member_that_two_rows_name(d: Draft) -> None:
    archive_images(d, plain)
    d.set("frames", ("file",), ARCHIVE, rollout_id=BRAKE, camera="rear", tick=TICKS[0])
    (row,) = d.take("frames", rollout_id=NOMINAL, camera="rear", tick=TICKS[0]).to_pylist()
    for column in ("offset_bytes", "checksum"):
        d.set("frames", column, row[column], rollout_id=BRAKE, camera="rear", tick=TICKS[0])


@mutant("BD-FRM-013", base="media", at={"file": f"{SHARD_0}/{ARCHIVE}"})
def archive_that_no_row_names(d: Draft) -> None:
    content, _ = plain([(member_name(NOMINAL, TICKS[0], "rear", "png"), unseen())])
    d.before_seal(lambda root: (root / SHARD_0 / ARCHIVE).write_bytes(content))


for kind, writer in FOREIGN.items():
    boundary("BD-FRM-013", "BD-FRM-002", base="media", name=f"archive_{kind.replace(' ', '_')}")(_written(writer))


@boundary("BD-FRM-013", "BD-FRM-002", "BD-FRM-005", base="media")
def images_of_two_attempts_in_an_archive(d: Draft) -> None:
    archive_images(d, plain, (BRAKE, NOMINAL))


@boundary("BD-FRM-013", base="media")
def archive_without_a_member(d: Draft) -> None:
    d.before_seal(lambda root: (root / SHARD_0 / ARCHIVE).write_bytes(bytes(10_240)))


@boundary("BD-FRM-013", base="media")
def index_in_another_order_than_its_archive(d: Draft) -> None:
    archive_images(d, plain)
    d.map_table("frames", lambda rows: rows.take(np.arange(len(rows))[::-1]), folder=SHARD_0)


# BD-LAY-007, of the index


def repeated(d: Draft, num_rows: int) -> None:
    """Let as many rows of one camera name one range."""
    content = png(COLOURS)
    rows = d.take("frames", camera="rear", tick=range(BRANCH_TICK + 1))
    in_shard = [row for row in rows.to_pylist() if d.folder_of(row["rollout_id"]) == SHARD_0][:num_rows]
    for row in in_shard:
        replace_image(d, content, camera="rear", rollout_id=row["rollout_id"], tick=row["tick"])
    assert len(in_shard) == num_rows


@boundary("BD-LAY-007", "BD-FRM-002", "BD-FRM-005", base="media")
def range_that_as_many_rows_name_as_may(d: Draft) -> None:
    repeated(d, spec_limits().max_range_rows)
