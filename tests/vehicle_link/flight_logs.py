"""Logs as an autopilot's card and a ground station write them, by their formats."""

from __future__ import annotations

import struct

from pymavlink.dialects.v20 import ardupilotmega as m

HEAD = b"\xa3\x95"
GPS_EPOCH, WEEK, LEAP = 315_964_800, 604_800, 18

ROWS = {
    "PARM": (20, "QNff", "TimeUS,Name,Value,Default", "<Q16sff"),
    "MODE": (21, "QMBB", "TimeUS,Mode,ModeNum,Rsn", "<QBBB"),
    "EV": (22, "QB", "TimeUS,Id", "<QB"),
    "GPS": (23, "QBBIH", "TimeUS,I,Status,GMS,GWk", "<QBBIH"),
    "GPA": (25, "QBI", "TimeUS,I,SMS", "<QBI"),
    "POS": (24, "QLLfff", "TimeUS,Lat,Lng,Alt,RelHomeAlt,RelOriginAlt", "<Qiifff"),
}
"""Number, types, columns and packing of the messages that matter."""


def card_log(path, system, utc, boot, places, *, mode=3, held_up=None):
    """Write a ``.BIN``.

    ``held_up``: as ArduPilot's simulation does, which begins after the event of arming,
    and writes fixes so late [s], with the time at which they were received.

    ``utc`` of each place [s], ``boot`` is the UTC at which the vehicle started [s],
    ``places`` are latitude, longitude [deg], height above home [m].
    """
    out = bytearray()

    def describe(number, size, name, types, columns):
        row = struct.pack("<BB4s16s64s", number, size, name, types, columns)
        out.extend(HEAD + bytes([128]) + row)

    def add(name, *values):
        number, _, _, packing = ROWS[name]
        out.extend(HEAD + bytes([number]) + struct.pack(packing, *values))

    describe(128, 89, b"FMT", b"BBnNZ", b"Type,Length,Name,Format,Columns")
    for name, (number, types, columns, packing) in ROWS.items():
        size = 3 + struct.calcsize(packing)
        describe(number, size, name.encode(), types.encode(), columns.encode())
    add("PARM", 1, b"SYSID_THISMAV", float(system), 1.0)
    micros = [round((moment - boot) * 1e6) for moment in utc]
    add("MODE", micros[0], mode, mode, 1)
    if held_up is None:
        add("EV", micros[0], 10)
    for moment, stamp, (latitude, longitude, height) in zip(
        utc, micros, places, strict=True
    ):
        gps = moment - GPS_EPOCH + LEAP
        week = int(gps // WEEK)
        # As a receiver's: cut to its period, and logged a little late.
        cut = int((gps - week * WEEK) * 5.0) / 5.0
        written = stamp + round(1e6 * (held_up or 0.0))
        add("GPS", written, 0, 4, round(cut * 1000), week)
        if held_up is not None:
            received = cut + week * WEEK + GPS_EPOCH - LEAP - boot
            add("GPA", written, 0, round(received * 1000))
        add(
            "POS",
            stamp,
            round(latitude * 1e7),
            round(longitude * 1e7),
            0.0,
            height,
            0.0,
        )
    add("EV", micros[-1] + 1, 11)
    for stamp in range(micros[-1] + 2, micros[-1] + 5_000_002, 1_000_000):
        add("POS", stamp, 0, 0, 0.0, 500.0, 0.0)
    path.write_bytes(out)


def telemetry_log(path, vehicles, *, mode=3):
    """Write a ``.tlog``; ``vehicles`` gives system, UTC, boot and places of each."""
    rows = []
    for system, utc, boot, places in vehicles:
        codec = m.MAVLink(None, system, 1)
        beat = m.MAVLink_heartbeat_message(2, 3, 128 | 1, mode, 4, 3)
        rows.append((utc[0] - 0.01, beat.pack(codec)))
        for moment, (latitude, longitude, height) in zip(utc, places, strict=True):
            stamp = round((moment - boot) * 1e3)
            time = m.MAVLink_system_time_message(round(moment * 1e6), stamp)
            place = m.MAVLink_global_position_int_message(
                stamp,
                round(latitude * 1e7),
                round(longitude * 1e7),
                0,
                round(height * 1e3),
                0,
                0,
                0,
                0,
            )
            rows += [(moment, time.pack(codec)), (moment, place.pack(codec))]
    rows.sort(key=lambda row: row[0])
    path.write_bytes(
        b"".join(struct.pack(">Q", round(when * 1e6)) + data for when, data in rows)
    )
