"""pymavlink as the autopilot of somebody else's simulator: flies turns, the module calibrates by its ATTITUDE.

The aircraft lies as this script says (--world), and roll, pitch and body rates come from this script, too, as an
autopilot would send them: HEARTBEAT once, ATTITUDE fifty times a second. Leaves the calibration in FLASH.
"""

import math
import random
import re
import select
import time

import pynmea2
from pymavlink import mavutil
from pymavlink.dialects.v20 import common as mavlink

from served import HEADING_BOUND_DEG, PATIENCE_S, Served, wrap_180

SPEED = 5.0
PERIOD_S = 0.02
BANK_DEG = 25.0
BANK_RATE_DEG_S = 20.0
# Of an aeroplane of 22 m/s at that bank: 30 s for a circle.
TURN_RATE_DEG_S = math.degrees(9.81 * math.tan(math.radians(BANK_DEG)) / 22.0)
# Attitude as good as an autopilot's, and never twice the same.
NOISE_DEG = 0.1
# Afterwards it flies straight on at this heading.
HEADING_DEG = 60.0


class Aircraft:
    """Banks at a limited rate, turns by its bank."""

    def __init__(self):
        self.roll_deg = self.roll_rate_deg_s = self.heading_deg = self.heading_rate_deg_s = 0.0

    def fly(self, bank_deg, seconds):
        """Goes on towards a bank."""
        step = BANK_RATE_DEG_S * seconds
        change = max(-step, min(step, bank_deg - self.roll_deg))
        self.roll_deg += change
        self.roll_rate_deg_s = change / seconds
        self.heading_rate_deg_s = TURN_RATE_DEG_S * self.roll_deg / BANK_DEG
        self.heading_deg = (self.heading_deg + self.heading_rate_deg_s * seconds) % 360.0

    def rates_rad_s(self):
        """Body rates p, q, r at no pitch."""
        roll, turn = math.radians(self.roll_deg), math.radians(self.heading_rate_deg_s)
        return math.radians(self.roll_rate_deg_s), turn * math.sin(roll), turn * math.cos(roll)


def turning(seconds):
    """Three circles and a little to the right, as many to the left, and again: a busy computer loses some of it."""
    circles_s = 3.2 * 360.0 / TURN_RATE_DEG_S
    return BANK_DEG if int(seconds / circles_s) % 2 == 0 else -BANK_DEG


class Flight:
    """The aircraft, and who sends of it."""

    def __init__(self, module):
        self.module = module
        self.link = mavutil.mavlink_connection(f"tcp:127.0.0.1:{module.tcp}", source_system=1, source_component=1)
        self.aircraft, self.noise = Aircraft(), random.Random(1)
        self.began = time.monotonic()
        self.flown_s, self.beats = 0.0, 0

    def go_on(self, bank_deg):
        """Flies on at a bank for a period, in the time that it takes."""
        aircraft, mav = self.aircraft, self.link.mav
        aircraft.fly(bank_deg, PERIOD_S)
        self.flown_s += PERIOD_S
        time.sleep(max(0.0, self.began + self.flown_s / SPEED - time.monotonic()))
        self.module.lie(aircraft.roll_deg, 0.0, aircraft.heading_deg)
        if self.flown_s >= self.beats:
            self.beats += 1
            kind, autopilot = mavlink.MAV_TYPE_FIXED_WING, mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA
            mav.heartbeat_send(kind, autopilot, 0, 0, mavlink.MAV_STATE_ACTIVE)
        roll, pitch = (math.radians(deg + self.noise.gauss(0.0, NOISE_DEG)) for deg in (aircraft.roll_deg, 0.0))
        mav.attitude_send(int(self.flown_s * 1000.0), roll, pitch, 0.0, *aircraft.rates_rad_s())


def calibrate(module, flight):
    """Flies until the module says that it has calibrated."""
    while not re.search("note (calibrated: .*|refused .*)\r\n", module.printed):
        flight.go_on(turning(flight.flown_s))
        assert flight.flown_s < 800.0, f"no calibration: {module.type('status', 'saves: ')}"
        if select.select([module.console], [], [], 0.0)[0]:
            module.listen()


def check_headings(module, flight):
    """Flies on: the headings are those that are flown."""
    nmea = module.connect(module.tcp)
    nmea.settimeout(PATIENCE_S)
    read, good = b"", 0
    until_s = flight.flown_s + 60.0
    while good < 20:
        assert flight.flown_s < until_s, "no headings"
        error_deg = wrap_180(HEADING_DEG - flight.aircraft.heading_deg)
        flight.go_on(max(-BANK_DEG, min(BANK_DEG, error_deg)))
        if not select.select([nmea], [], [], 0.0)[0]:
            continue
        *lines, read = (read + nmea.recv(4096)).split(b"\r\n")
        for line in lines:
            if not line.startswith(b"$HCHDM,") or abs(flight.aircraft.roll_deg) > 1.0:
                continue
            heading = pynmea2.parse(line.decode(), check=True).heading
            if heading is not None:
                error_deg = wrap_180(float(heading) - flight.aircraft.heading_deg)
                assert abs(error_deg) < HEADING_BOUND_DEG, f"{line}: {error_deg:.1f} deg off"
                good += 1


with Served("--attitude", "peer", "--speed", str(SPEED)) as module:
    flight = Flight(module)
    module.type("cal start turns", "ok collecting")
    calibrate(module, flight)
    note = re.search("note .*", module.printed)[0].strip()
    assert note.startswith("note calibrated: "), note
    assert "attitude from who is attached" in module.status()
    check_headings(module, flight)
    module.type("status", "saves: ")
    assert " 0 rejected, 0 line errors" in module.printed, module.printed
print(f"pymavlink: {note}")
