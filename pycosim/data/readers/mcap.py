"""An MCAP file with channels of JSON messages comes in; a Table goes out.

A field ``position`` of the messages on ``/joints`` is the column ``/joints.position``; an entry of an array,
``/joints.position[0]``. The column ``time`` is the time of publication, from the first message on [s]. Messages of
other encodings (ROS, Protobuf) are passed over: they need schemas that the file's writer knows.
"""

from __future__ import annotations

import json
import struct

import numpy as np

from ...core.errors import DataError
from . import Table, numbers, one_clock, optional

TIME = "time"


def read(path, wanted, text):
    """Read the wanted fields of an MCAP file; see `pycosim.data.readers.read_parts`.

    Raises
    ------
    DataError
        mcap is not installed, the file is not MCAP or cut short, no channel is JSON, a message is not, or the wanted
        fields were not published together.
    """
    reader = optional(path, "mcap", "mcap.reader", "MCAP", "mcap")
    failures = optional(path, "mcap", "mcap.exceptions", "MCAP", "mcap").McapError
    try:
        with path.open("rb") as stream:
            series, header, others = _collect(path, reader.make_reader(stream), wanted | {text})
    except (failures, EOFError, ValueError, OSError, struct.error) as error:  # the last two of a length that is junk
        why = str(error) or type(error).__name__
        raise DataError(f"{path}: is not an MCAP file, or is cut short ({why}); repair it, or export the log as CSV or "
                        "Parquet") from None
    if not header:
        raise DataError(f"{path}: has no message encoded as JSON (but {', '.join(sorted(others)) or 'none at all'}); "
                        "write the channels as JSON, or export them as CSV or Parquet")
    columns = {n: _labels(v) if n == text else numbers(path, n, v) for n, (_, v) in series.items()}
    if not columns:
        return Table({TIME: np.empty(0)}, [TIME, *header], np.arange(0))
    clock = one_clock(path, {n: np.array(t) for n, (t, _) in series.items()})
    if TIME in wanted:
        columns[TIME] = (clock - clock[0]) * 1e-9
    return Table(columns, [TIME, *header], np.arange(len(clock)) + 1)


def _collect(path, reader, wanted):
    """Times [ns] and values of the wanted fields, the names of all fields, and the encodings that are not JSON."""
    series, header, others, of_topic = {}, {}, set(), {}
    for _, channel, message in reader.iter_messages():
        if channel.message_encoding != "json":
            others.add(channel.message_encoding or "unnamed")
            continue
        try:
            content = json.loads(message.data)
        except ValueError:
            raise DataError(f"{path}: message {message.sequence} on '{channel.topic}' is not JSON, though its channel "
                            "says so") from None
        fields = dict(_fields(content, channel.topic))
        header.update(dict.fromkeys(fields))
        known = of_topic.setdefault(channel.topic, set())
        known |= wanted & fields.keys()
        for name in known:
            times, values = series.setdefault(name, ([], []))
            times.append(message.publish_time)
            values.append(fields.get(name))
    return series, list(header), others


def _fields(content, name):
    """Yield the names and values of everything in a message."""
    if isinstance(content, dict):
        for key, value in content.items():
            yield from _fields(value, f"{name}.{key}")
    elif isinstance(content, list):
        for k, value in enumerate(content):
            yield from _fields(value, f"{name}[{k}]")
    else:
        yield name, content


def _labels(values):
    return np.array(["" if v is None else str(v) for v in values])
