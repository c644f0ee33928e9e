"""Signal K's NMEA parser (@signalk/nmea0183-signalk) in boat.js reads the port of a module served by this script."""

import subprocess
from pathlib import Path

from served import HEADING_BOUND_DEG, PATIENCE_S, Served

HEADING_DEG = 301.0

with Served() as module:
    module.hold(HEADING_DEG)
    command = ["node", Path(__file__).with_name("boat.js"), str(module.tcp), str(HEADING_DEG), str(HEADING_BOUND_DEG)]
    subprocess.run(command, check=True, timeout=PATIENCE_S)
