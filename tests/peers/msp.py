"""MSP autopilot that uses the module as its compass and answers its requests, with an independent frame codec.

MSP_ATTITUDE has pitch nose up in ArduPilot, nose down in INAV: both are simulated, on a constant heading.
"""

import math
import select
import socket
import struct
import time

from served import PATIENCE_S, ServedModule, check_errors, wrap_180

COMPASS, FC_VARIANT, STATUS, RAW_GPS, ATTITUDE, RTC = 0x1F04, 2, 101, 106, 108, 247
HEADING_DEG = 147.0
# Xi'an; WMM2025: 526 mG in 2026.
LATITUDE_DEG, LONGITUDE_DEG, TOTAL_MG = 34.3416, 108.9398, 526.0
READINGS = 150


def crc8(data):
    """CRC-8/DVB-S2."""
    crc = 0
    for byte in data:
        crc ^= byte
        for _ in range(8):
            crc = ((crc << 1) ^ 0xD5 if crc & 0x80 else crc << 1) & 0xFF
    return crc


def frame(function, payload):
    """Reply frame."""
    body = struct.pack("<BHH", 0, function, len(payload)) + payload
    return b"$X>" + body + bytes([crc8(body)])


def frames(stream):
    """Complete requests of a stream without other bytes, and the rest of the stream."""
    found = []
    while len(stream) >= 9:
        assert stream[:3] == b"$X<", stream[:20]
        flags, function, length = struct.unpack_from("<BHH", stream, 3)
        if len(stream) < 9 + length:
            break
        assert flags == 0 and crc8(stream[3 : 8 + length]) == stream[8 + length], stream[: 9 + length]
        found.append((function, stream[8 : 8 + length]))
        stream = stream[9 + length :]
    return found, stream


def answer(function, variant):
    """Reply of a level, disarmed autopilot; None for an unknown function."""
    unix_s = int(time.time())
    return {
        FC_VARIANT: variant,
        ATTITUDE: struct.pack("<hhh", 0, 0, int(HEADING_DEG)),
        STATUS: struct.pack("<HHHIB", 500, 0, 1, 0, 0),
        RAW_GPS: struct.pack("<BBiiHHH", 2, 9, int(LATITUDE_DEG * 1e7), int(LONGITUDE_DEG * 1e7), 400, 0, 0),
        RTC: struct.pack("<IH", unix_s, 0) if variant == b"INAV" else struct.pack("<HBBBBBH", *time.gmtime(unix_s)[:6], 0),
    }.get(function)


def receive_compass_samples(variant):
    """Compass samples received by one autopilot from power-up."""
    with ServedModule("--attitude", "peer") as module:
        module.hold_heading(HEADING_DEG)
        line = socket.create_connection(("127.0.0.1", module.autopilot_tcp), timeout=PATIENCE_S)
        asked, readings, stream, began = set(), [], b"", time.monotonic()
        while len(readings) < READINGS or not asked >= {FC_VARIANT, STATUS, RAW_GPS, ATTITUDE, RTC}:
            assert time.monotonic() - began < PATIENCE_S, (asked, len(readings))
            if not select.select([line], [], [], 1.0)[0]:
                continue
            stream += line.recv(4096)
            if not (asked or readings):
                # Drops an incomplete first frame.
                stream = stream[max(0, stream.find(b"$X<")) :]
            found, stream = frames(stream)
            for function, payload in found:
                if function == COMPASS:
                    readings.append(struct.unpack("<BIhhh", payload))
                    continue
                asked.add(function)
                reply = answer(function, variant)
                if reply is not None:
                    line.sendall(frame(function, reply))
        printed = module.type("status all", "saves: ")
        assert "found msp" in printed and "armed: no" in printed and "attitude: roll 0.0 deg" in printed, printed
        assert "ok calibrated" in printed and "by the field model" in printed, printed
    return readings


for variant in (b"ARDU", b"INAV"):
    readings = receive_compass_samples(variant)[READINGS // 3 :]
    times = [reading[1] for reading in readings]
    assert times == sorted(times), times
    errors = [wrap_180(math.degrees(math.atan2(-y, x)) - HEADING_DEG) for _, _, x, y, _ in readings]
    mean_deg = check_errors(errors)
    strength = sum(math.hypot(*reading[2:]) for reading in readings) / len(readings)
    assert abs(strength - TOTAL_MG) < 12.0, strength
    print(f"msp, {variant.decode()}: {len(readings)} readings, mean error {mean_deg:.1f} deg, {strength:.0f} mG")
