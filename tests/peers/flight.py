"""Calibration flight of an external simulator, autopilot and ground station, implemented with pymavlink.

The flight provides the attitude of the aircraft (--world) and sends roll, pitch and body rates as ArduPilot does: ATTITUDE
at 1 Hz until requested, and 50 Hz is denied. The ground station starts, cancels and restarts a calibration and reads the
result; the console is unused. The calibration is stored in FLASH. The MAVLink link is the caller's: a serial port of the module
(autopilot.py), or the CAN bus (tunnel.py).
"""

import math
import os
import random
import select
from collections import Counter

import pynmea2

# This dialect contains all MAG_CAL_* messages.
os.environ["MAVLINK20"] = "1"
from pymavlink import mavutil
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from served import PATIENCE_S, ServedModule, check_errors, wrap_180

mavutil.set_dialect("ardupilotmega")

PERIOD_S = 0.02
BANK_DEG = 25.0
BANK_RATE_DEG_S = 20.0
# Aeroplane at 22 m/s and this bank: 30 s per circle.
TURN_RATE_DEG_S = math.degrees(9.81 * math.tan(math.radians(BANK_DEG)) / 22.0)
# Typical attitude noise; values never repeat.
NOISE_DEG = 0.1
# Heading of the straight flight afterwards.
HEADING_DEG = 60.0
# System and component IDs of module and ground station.
MODULE = (1, 158)
# Sender of the first requests, while the module listens for another one with its component.
LISTENING_MODULE = (1, 99)
ADDRESSES = {"source_system": 1, "source_component": 1}
STATION = (255, 190)
# Shortest message interval that ArduPilot accepts for aeroplanes.
LEAST_INTERVAL_US = 25_000


class Aircraft:
    """Banks at a limited rate, turns by its bank."""

    def __init__(self):
        self.roll_deg = self.roll_rate_deg_s = self.heading_deg = self.heading_rate_deg_s = 0.0

    def fly(self, bank_deg, seconds):
        """Advances by one step toward a bank."""
        step = BANK_RATE_DEG_S * seconds
        change = max(-step, min(step, bank_deg - self.roll_deg))
        self.roll_deg += change
        self.roll_rate_deg_s = change / seconds
        self.heading_rate_deg_s = TURN_RATE_DEG_S * self.roll_deg / BANK_DEG
        self.heading_deg = (self.heading_deg + self.heading_rate_deg_s * seconds) % 360.0

    def rates_rad_s(self):
        """Body rates p, q, r at zero pitch."""
        roll, turn = math.radians(self.roll_deg), math.radians(self.heading_rate_deg_s)
        return math.radians(self.roll_rate_deg_s), turn * math.sin(roll), turn * math.cos(roll)


def bank_at(seconds):
    """Bank at a time: 3.2 circles right, then left, and again."""
    circles_s = 3.2 * 360.0 / TURN_RATE_DEG_S
    return BANK_DEG if int(seconds / circles_s) % 2 == 0 else -BANK_DEG


class Flight:
    """Aircraft, its MAVLink senders on a link to the module, and the messages received from it."""

    def __init__(self, module, link):
        self.module, self.link = module, link
        self.station = mavlink.MAVLink(self.link, srcSystem=STATION[0], srcComponent=STATION[1])
        self.aircraft, self.noise = Aircraft(), random.Random(1)
        self.flown_s, self.heartbeat_count, self.attitude_sent_s, self.rate_hz = 0.0, 0, 0.0, 1.0
        self.message_counts, self.texts, self.answers = Counter(), [], []
        self.last, self.requested_rates_hz = {}, []

    def fly_period(self, bank_deg):
        """Flies at a bank for one period of the module's time, sends the aircraft's messages, and records the module's."""
        aircraft, mav = self.aircraft, self.link.mav
        self.flown_s += PERIOD_S
        aircraft.fly(bank_deg, PERIOD_S)
        if self.flown_s >= self.heartbeat_count:
            self.heartbeat_count += 1
            kind, autopilot = mavlink.MAV_TYPE_FIXED_WING, mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA
            mav.heartbeat_send(kind, autopilot, 0, 0, mavlink.MAV_STATE_ACTIVE)
        if (self.flown_s - self.attitude_sent_s) * self.rate_hz >= 0.999:
            self.attitude_sent_s = max(self.attitude_sent_s + 1.0 / self.rate_hz, self.flown_s - PERIOD_S)
            roll, pitch = (math.radians(deg + self.noise.gauss(0.0, NOISE_DEG)) for deg in (aircraft.roll_deg, 0.0))
            mav.attitude_send(int(self.flown_s * 1000.0), roll, pitch, 0.0, *aircraft.rates_rad_s())
        self.module.step(aircraft.roll_deg, 0.0, aircraft.heading_deg, PERIOD_S)
        while (message := self.link.recv_match()) is not None:
            self.record_message(message)

    def record_message(self, message):
        """Records a message of the module; invalid bytes count as BAD_DATA."""
        name = message.get_type()
        self.message_counts[name] += 1
        if name == "BAD_DATA":
            return
        sender = message.get_srcSystem(), message.get_srcComponent()
        assert sender == MODULE or sender == LISTENING_MODULE and name in ("COMMAND_LONG", "PARAM_REQUEST_READ"), message
        self.last[name] = message
        if name == "STATUSTEXT":
            if message.chunk_seq == 0:
                self.texts.append("")
            # Without the spaces that fill the chunks.
            self.texts[-1] = " ".join(self.texts[-1].split() + message.text.split())
        elif name == "COMMAND_ACK":
            assert (message.target_system, message.target_component) == STATION, message
            self.answers.append((message.command, message.result))
        elif name == "COMMAND_LONG":
            self.answer_request(message)

    def answer_request(self, command):
        """Answers message requests: accepts attitude up to 40 Hz; other messages fail."""
        assert command.command == mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, command
        result = mavlink.MAV_RESULT_FAILED
        if command.param1 == mavlink.MAVLINK_MSG_ID_ATTITUDE:
            self.requested_rates_hz.append(round(1e6 / command.param2))
            result = mavlink.MAV_RESULT_DENIED
            if command.param2 >= LEAST_INTERVAL_US:
                self.rate_hz, result = 1e6 / command.param2, mavlink.MAV_RESULT_ACCEPTED
        self.link.mav.command_ack_send(command.command, result, 0, 0, *MODULE)

    def send_command(self, command):
        """Sends a command from the ground station and waits for the answer."""
        self.answers.clear()
        self.station.command_long_send(*MODULE, command, 0, 0, 0, 0, 0, 0, 0, 0)
        until_s = self.flown_s + 20.0
        while not self.answers:
            assert self.flown_s < until_s, f"no answer to {command}"
            self.fly_period(0.0)
        assert self.answers == [(command, mavlink.MAV_RESULT_ACCEPTED)], self.answers


def calibrate(flight):
    """Flies until the module reports the result of its calibration."""
    began_s = flight.flown_s
    while "MAG_CAL_REPORT" not in flight.last:
        flight.fly_period(bank_at(flight.flown_s - began_s))
        assert flight.flown_s - began_s < 800.0, f"no calibration: {flight.message_counts} {flight.texts}"
    report = flight.last["MAG_CAL_REPORT"]
    assert (report.cal_status, report.autosaved) == (mavlink.MAG_CAL_SUCCESS, 1), (report, flight.texts)
    # Hard iron of the airframe as additive offsets in milligauss: some tens of microtesla.
    assert 30.0 < math.hypot(report.ofs_x, report.ofs_y, report.ofs_z) < 1000.0, report
    assert 0.7 < report.diag_x < 1.4 and 0.7 < report.diag_y < 1.4 and 0.7 < report.diag_z < 1.4, report
    return report


def check_headings(module, flight):
    """Checks the reported headings in flight."""
    nmea = module.connect(module.tcp)
    nmea.settimeout(PATIENCE_S)
    read, errors = b"", []
    until_s = flight.flown_s + 60.0
    while len(errors) < 20:
        assert flight.flown_s < until_s, "no headings"
        error_deg = wrap_180(HEADING_DEG - flight.aircraft.heading_deg)
        flight.fly_period(max(-BANK_DEG, min(BANK_DEG, error_deg)))
        if not select.select([nmea], [], [], 0.0)[0]:
            continue
        *lines, read = (read + nmea.recv(4096)).split(b"\r\n")
        for line in lines:
            if not line.startswith(b"$HCHDM,") or abs(flight.aircraft.roll_deg) > 1.0:
                continue
            heading = pynmea2.parse(line.decode(), check=True).heading
            if heading is not None:
                errors.append(wrap_180(float(heading) - flight.aircraft.heading_deg))
    check_errors(errors)


def fly(module, link):
    """Flies as autopilot of a module without a calibration until it reports right headings; returns the flight."""
    flight = Flight(module, link)
    while flight.rate_hz < 20.0:
        flight.fly_period(0.0)
        assert flight.flown_s < 30.0, f"attitude was not asked for: {flight.requested_rates_hz}"
    assert flight.requested_rates_hz[-1] == 40, flight.requested_rates_hz
    flight.send_command(mavlink.MAV_CMD_DO_START_MAG_CAL)
    for _ in range(250):
        flight.fly_period(BANK_DEG)
    flight.send_command(mavlink.MAV_CMD_DO_CANCEL_MAG_CAL)
    assert "MAG_CAL_REPORT" not in flight.last, flight.last
    flight.send_command(mavlink.MAV_CMD_DO_START_MAG_CAL)
    broken = flight.message_counts["BAD_DATA"]
    report = calibrate(flight)
    assert "attitude from who is attached" in module.status()
    check_headings(module, flight)
    # After detecting MAVLink the module sends no more MSP requests.
    assert flight.message_counts["BAD_DATA"] == broken, flight.message_counts
    for name in ("HEARTBEAT", "MAG_CAL_PROGRESS", "NAMED_VALUE_FLOAT", "STATUSTEXT"):
        assert flight.message_counts[name] > 5 or name == "STATUSTEXT", flight.message_counts
    notes = [text for text in flight.texts if text.startswith("autoswing: calibrated: expected error ")]
    assert len(notes) == 1, flight.texts
    print(f"pymavlink: {notes[0]}; fitness {report.fitness:.1f} mG; {dict(flight.message_counts)}")
    return flight
