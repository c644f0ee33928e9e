"""`lab serve` as a child process of a peer.

LAB names the program, FLASH the file with the calibration by autopilot.py; scripts/peers sets both. Waiting for the
module fails after two silent minutes.
"""

import json
import os
import select
import signal
import socket
import subprocess
import threading
import time

PATIENCE_S = 120.0

# Bound of the mean error of some seconds of headings, degrees: calibration error of 1.0 (README), three sigmas of attitude bias
# (0.2) times the tangent of the inclination (54 deg), and what noise leaves in the mean.
MEAN_BOUND_DEG = 2.5
# Bound of one heading's difference from the mean, degrees: five sigmas. Sigma was measured: 0.75, of which the attitude's noise of 0.3
# causes 0.4, the magnetometer the rest.
NOISE_BOUND_DEG = 3.75


def wrap_180(deg):
    """Wraps an angle to -180..180 degrees."""
    return (deg + 180.0) % 360.0 - 180.0


def check_errors(errors_deg):
    """Fails if the mean of heading errors, or the difference of one from it, exceeds its bound; returns the mean."""
    mean_deg = sum(errors_deg) / len(errors_deg)
    assert abs(mean_deg) < MEAN_BOUND_DEG, f"mean error {mean_deg:.1f} deg: {errors_deg}"
    noisy = [round(error, 1) for error in errors_deg if abs(error - mean_deg) >= NOISE_BOUND_DEG]
    assert not noisy, f"{noisy} deg off, of mean {mean_deg:.1f}"
    return mean_deg


class ServedModule:
    """Served module: `with ServedModule("--speed", "2") as module:`."""

    def __init__(self, *arguments, flash=None):
        command = [os.environ["LAB"], "serve", "--json", "--tcp", "0", "--world", "0"]
        command += ["--flash", flash or os.environ["FLASH"], *arguments]
        self.process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE)
        places = json.loads(self.process.stdout.readline())
        console, autopilot, instrument = places["ports"]
        self.autopilot_tcp = autopilot["tcp"]
        self.pty, self.tcp = instrument["pty"], instrument["tcp"]
        self.world = ("127.0.0.1", places["world"])
        self.datagrams = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.console = self.connect(console["tcp"])
        self.printed = ""
        self.held = threading.Event()
        self.stepped_attitude = None

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.held.set()
        self.process.send_signal(signal.SIGINT)
        assert self.process.wait(timeout=PATIENCE_S) == 130, "it ends cleanly"

    @staticmethod
    def connect(port):
        return socket.create_connection(("127.0.0.1", port), timeout=PATIENCE_S)

    def send_attitude(self, roll_deg, pitch_deg, yaw_deg):
        """Sends an attitude of the aircraft."""
        self.datagrams.sendto(f"{roll_deg:.4f} {pitch_deg:.4f} {yaw_deg:.4f}".encode(), self.world)

    def step(self, roll_deg, pitch_deg, yaw_deg, step_s):
        """Sends an attitude and lets the module go on by a step; from the first step on its time stands still between them."""
        self.stepped_attitude = (roll_deg, pitch_deg, yaw_deg)
        self.datagrams.settimeout(PATIENCE_S)
        self.datagrams.sendto(f"{roll_deg:.4f} {pitch_deg:.4f} {yaw_deg:.4f} {step_s:.4f}".encode(), self.world)
        self.datagrams.recv(64)

    def hold_heading(self, yaw_deg):
        """Holds the aircraft level at a heading until this object is closed; returns after a second, when it is reached."""

        def keep_sending():
            while not self.held.wait(0.05):
                self.send_attitude(0.0, 0.0, yaw_deg)

        threading.Thread(target=keep_sending, daemon=True).start()
        time.sleep(1.0)

    def type(self, line, answer):
        """Types a line on the console, waits for its answer and returns all output until then."""
        self.printed = ""
        self.console.sendall(line.encode() + b"\r")
        while answer not in self.printed:
            if self.stepped_attitude:
                self.step(*self.stepped_attitude, 0.02)
            if not self.stepped_attitude or select.select([self.console], [], [], 0.0)[0]:
                self.read_output()
        return self.printed

    def read_output(self):
        """Reads the next console output."""
        more = self.console.recv(4096)
        assert more, "the module has gone"
        self.printed += more.decode()

    def status(self):
        """Status of the simulator with the true state."""
        self.process.stdin.write(b"status\n")
        self.process.stdin.flush()
        return self.process.stdout.readline().decode()
