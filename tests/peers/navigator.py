"""gpsd as a navigation program that reports the module's heading to its clients.

gpsd reports a heading only with a position, so this script is also an NMEA multiplexer: it forwards the module's sentences
and adds those of a stationary GPS once a second.
"""

import datetime
import json
import socket
import subprocess
import threading

import pynmea2

from served import PATIENCE_S, ServedModule, check_errors, wrap_180

HEADING_DEG = 217.0
# By the field model at Xi'an, whose position and date the simulator reports. gpsd 3.22 reports the true heading as the magnetic one.
DECLINATION_DEG = -4.2


def gps_sentences():
    """First and last sentence of a GPS cycle at Xi'an."""
    time, date = datetime.datetime.now(datetime.timezone.utc).strftime("%H%M%S.00 %d%m%y").split()
    rmc = (time, "A", "3415.00", "N", "10856.00", "E", "0.0", "", date, "", "", "A")
    gga = (time, "3415.00", "N", "10856.00", "E", "1", "10", "0.9", "400.0", "M", "-30.0", "M", "", "")
    return [f"{sentence}\r\n".encode() for sentence in (pynmea2.RMC("GP", "RMC", rmc), pynmea2.GGA("GP", "GGA", gga))]


def multiplex(module, listener):
    """Sends the combined sentences to the connecting client."""
    gpsd, _ = listener.accept()
    try:
        # Three sentences at 10 Hz. gpsd treats sentences between the GPS's two as one cycle.
        for number, line in enumerate(module.connect(module.tcp).makefile("rb")):
            if number % 30 == 0:
                first, last = gps_sentences()
                gpsd.sendall(first)
            gpsd.sendall(line)
            if number % 30 == 3:
                gpsd.sendall(last)
    except OSError:
        # gpsd has ended.
        pass


def headings(client):
    """Magnetic headings reported by gpsd: with the position before version 3.23, as attitude since then."""
    for line in client:
        report = json.loads(line)
        heading = {"TPV": report.get("magtrack"), "ATT": report.get("mheading", report.get("heading"))}.get(report["class"])
        if heading is not None:
            yield heading


def connect_client(port, gpsd):
    """Client of a newly started gpsd."""
    while True:
        assert gpsd.poll() is None, "gpsd has ended"
        try:
            return socket.create_connection(("127.0.0.1", port), timeout=PATIENCE_S)
        except ConnectionRefusedError:
            pass


with ServedModule() as module, socket.create_server(("127.0.0.1", 0)) as listener, socket.socket() as free:
    module.hold_heading(HEADING_DEG)
    threading.Thread(target=multiplex, args=(module, listener), daemon=True).start()
    free.bind(("127.0.0.1", 0))
    port = free.getsockname()[1]
    free.close()
    command = ["gpsd", "-N", "-n", "-S", str(port), f"tcp://127.0.0.1:{listener.getsockname()[1]}"]
    gpsd = subprocess.Popen(command, stderr=subprocess.DEVNULL)
    try:
        client = connect_client(port, gpsd)
        client.sendall(b'?WATCH={"enable":true,"json":true};\n')
        received_headings = headings(client.makefile())
        headings_deg = [next(received_headings) for _ in range(5)]
    finally:
        gpsd.terminate()
        gpsd.wait()
    # gpsd's version decides whether it reports the true or the magnetic heading.
    errors = [[wrap_180(deg - reference) for deg in headings_deg] for reference in (HEADING_DEG, HEADING_DEG + DECLINATION_DEG)]
    mean_deg = check_errors(min(errors, key=lambda some: abs(sum(some))))
print(f"gpsd: {headings_deg}, mean error {mean_deg:.1f} deg")
