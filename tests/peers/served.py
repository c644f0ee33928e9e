"""The simulated module for a peer: `host-sim serve` as a child, gone when the peer is.

HOST_SIM names the program, FLASH the file in which autopilot.py leaves its calibration for the others; scripts/peers sets
both. A module that says nothing for two minutes fails the peer, whatever it waits for.
"""

import json
import os
import signal
import socket
import subprocess
import threading
import time

PATIENCE_S = 120.0

# What a heading may be off, degrees: a calibration of this airframe by 1.0 (README), and attitude that is off by three of
# its sigmas, 0.2 of bias and 0.3 of noise, for each of which the heading pays the tangent of 54 deg.
HEADING_BOUND_DEG = 2.5


def wrap_180(deg):
    """The same angle in -180..180."""
    return (deg + 180.0) % 360.0 - 180.0


class Served:
    """A served module: `with Served("--speed", "2") as module:`."""

    def __init__(self, *arguments):
        command = [os.environ["HOST_SIM"], "serve", "--json", "--tcp", "0", "--world", "0"]
        command += ["--flash", os.environ["FLASH"], *arguments]
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

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.held.set()
        self.process.send_signal(signal.SIGINT)
        assert self.process.wait(timeout=PATIENCE_S) == 130, "it ends cleanly"

    @staticmethod
    def connect(port):
        return socket.create_connection(("127.0.0.1", port), timeout=PATIENCE_S)

    def lie(self, roll_deg, pitch_deg, yaw_deg):
        """Brings the aircraft to an attitude."""
        self.datagrams.sendto(f"{roll_deg:.4f} {pitch_deg:.4f} {yaw_deg:.4f}".encode(), self.world)

    def hold(self, yaw_deg):
        """Keeps the aircraft level at a heading until the end, and waits until it has come there."""

        def tell():
            while not self.held.wait(0.05):
                self.lie(0.0, 0.0, yaw_deg)

        threading.Thread(target=tell, daemon=True).start()
        time.sleep(1.0)

    def type(self, line, answer):
        """Types a line on the console, waits for its answer, and gives all that was printed until then."""
        self.printed = ""
        self.console.sendall(line.encode() + b"\r")
        while answer not in self.printed:
            self.listen()
        return self.printed

    def listen(self):
        """Takes what the console prints next."""
        more = self.console.recv(4096)
        assert more, "the module has gone"
        self.printed += more.decode()

    def status(self):
        """What the simulator says of the truth."""
        self.process.stdin.write(b"status\n")
        self.process.stdin.flush()
        return self.process.stdout.readline().decode()
