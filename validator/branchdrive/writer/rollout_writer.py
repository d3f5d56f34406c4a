"""The writer of one rollout: rows arrive while it runs, and it is validated and written whole at the end.

Source: spec/05-raw-streams.md#tables.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping

from branchdrive.contract.columns import TABLES
from branchdrive.contract.descriptor import Descriptor
from branchdrive.contract.rule import CATALOGUE
from branchdrive.errors import ContractError, UsageError
from branchdrive.raw.media.media_folder import FRAMES
from branchdrive.raw.rollout import ROLLOUTS, Rollout, RolloutTables
from branchdrive.writer.buffer import RowBuffer, check_names, record_table
from branchdrive.writer.media_buffer import MediaBuffer

__all__ = ["RolloutWriter"]

_COUNTED = {"num_ticks": "controls", "num_observations": "observations"}
"""Row counts of the rollouts table and the streams that they count."""


class RolloutWriter:
    """Collects one rollout in memory, its images in a file; made by `GroupWriter.begin_rollout`.

    The ``append_*`` methods take the columns of their table by name, without ``rollout_id``: scalars
    for one row, or lists and numpy arrays of one length. ``None`` and masked entries are null, and
    columns that may be null may be left out, the descriptor's `unrecorded` among them. Floats are rounded
    to the declared width; no other type is converted.

    Nothing is in the dataset before `finish`: if the process dies, the attempt is not in the dataset and
    its number goes to the next one. A rollout that the simulator ended early is finished like any
    other, with status ``partial``.
    """

    def __init__(
        self,
        descriptor: Descriptor,
        fields: Mapping[str, object],
        end: Callable[[Rollout | None], None],
        images: MediaBuffer | None,
    ) -> None:
        self._descriptor = descriptor
        self._images = images
        self._fields = dict(fields)
        self._end = end
        self._is_over = False
        given = (TABLES[name] for name in descriptor.tables if name not in (ROLLOUTS, FRAMES))
        streams = [table for table in given if table.is_of_rollouts]
        self._buffers = {table.name: RowBuffer(table, descriptor.unrecorded) for table in streams}

    @property
    def rollout_id(self) -> str:
        """Identity of the attempt."""
        return str(self._fields["rollout_id"])

    @property
    def attempt(self) -> int:
        """Number of the attempt, from 1."""
        return int(str(self._fields["attempt"]))

    def append_ticks(self, **columns: object) -> None:
        """Append rows of the control audit, one per tick.

        Raises:
            ContractError: A column is unknown, missing, of a wrong type or of a wrong length.
            UsageError: The rollout is finished or abandoned.
        """
        self._append("controls", columns)

    def append_decisions(self, **columns: object) -> None:
        """Append what was chosen in a drive, one row per decision; see `append_ticks`."""
        self._append("decisions", columns)

    def append_observations(self, **columns: object) -> None:
        """Append rows of the ego and route state; see `append_ticks`."""
        self._append("observations", columns)

    def append_actors(self, **columns: object) -> None:
        """Append oriented boxes of actors; see `append_ticks`."""
        self._append("actors", columns)

    def append_evidence(self, **columns: object) -> None:
        """Append rows of the risk evidence; see `append_ticks`."""
        self._append("evidence", columns)

    def append_frame(self, tick: int, camera: str, image: bytes) -> None:
        """Append one encoded image, PNG or JPEG; it goes to a file at once, so that memory does not grow with images.

        Frames may come in any order, before or after their observations.

        Raises:
            ContractError: The bytes are no image of the camera: of another size, kind or number of channels, cut off
                or too large.
            UsageError: No media stream is claimed, the camera is not declared, the tick is that of no saved
                observation, the camera has an image of it already, or the rollout is finished or abandoned.
        """
        self._claimed_images().append(tick, camera, image)

    def keep_frames(self, ticks: Collection[int]) -> None:
        """Leave out the frames of all other ticks, once it is known which are wanted.

        Raises:
            UsageError: No media stream is claimed, or the rollout is finished or abandoned.
        """
        self._claimed_images().keep(ticks)

    def _claimed_images(self) -> MediaBuffer:
        self._check_open()
        if self._images is None:
            claimed = list(self._descriptor.streams)
            raise UsageError(f"frames belong to none of the streams that the descriptor claims: {claimed}")
        return self._images

    def _append(self, name: str, columns: Mapping[str, object]) -> None:
        self._check_open()
        if name not in self._buffers:
            claimed = list(self._descriptor.streams)
            raise ContractError(f"table `{name}`: belongs to none of the streams that the descriptor claims: {claimed}")
        self._buffers[name].append(columns)

    def _check_open(self) -> None:
        if self._is_over:
            raise UsageError(f"rollout `{self.rollout_id}` is finished or abandoned; begin another one")

    def finish(self, **fields: object) -> Rollout:
        """Validate the rollout and write it, wholly or not at all.

        Args:
            **fields: Columns of the rollouts table that `begin_rollout` did not get.

        Returns:
            The rollout as it will be read back, its images until the group's shard is written.

        Raises:
            ContractError: The rollout breaks the format; nothing is written and it stays open.
            UsageError: The rollout is over, or a field is given twice.
        """
        self._check_open()
        twice = sorted(fields.keys() & self._fields.keys())
        if twice:
            raise UsageError(f"rollout `{self.rollout_id}`: fields {twice} were given to `begin_rollout` already")
        counts = {name: self._buffers[table].num_rows for name, table in _COUNTED.items()}
        given = self._fields | fields
        allowed = {column.name for column in TABLES[ROLLOUTS].columns} - counts.keys()
        unrecorded = self._descriptor.unrecorded
        required = {c.name for c in TABLES[ROLLOUTS].columns if c.is_required(unrecorded)} - counts.keys()
        check_names(given.keys(), allowed, required, f"rollout `{self.rollout_id}`")
        record = record_table(TABLES[ROLLOUTS], given | counts).to_pylist()[0]
        tables = {name: buffer.to_table(self.rollout_id) for name, buffer in self._buffers.items()}
        if self._images is not None:
            tables[FRAMES] = self._images.to_table(self.rollout_id)
        rollout = Rollout(record, RolloutTables(tables), self._images.folder if self._images else None)
        refuse_violations(rollout, self._descriptor)
        self._end(rollout)
        self._is_over = True
        return rollout

    def abandon(self) -> None:
        """Discard the rollout: nothing tells that it was made, and its attempt number is used again.

        This is for attempts that failed to be made. To keep one that ended early, `finish` it with
        status ``partial``.
        """
        self._check_open()
        self._end(None)
        self._is_over = True


def refuse_violations(rollout: Rollout, descriptor: Descriptor) -> None:
    """Apply the structure rules to one rollout.

    Raises:
        ContractError: With one finding per violation.
    """
    from branchdrive.engine.rollout import check_rollout_structure

    findings = check_rollout_structure(rollout.record, rollout.tables, descriptor)
    if findings:
        lines = [f"- {finding.rule} {finding.message}; {CATALOGUE[finding.rule].remedy}" for finding in findings]
        head = f"rollout `{rollout.rollout_id}` breaks the format and was not written:"
        raise ContractError("\n".join([head, *lines]), findings)
