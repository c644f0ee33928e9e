"""Signal K's NMEA parser (@signalk/nmea0183-signalk) in boat.js reads the port of a module served by this script."""

import json
import subprocess
from pathlib import Path

from served import PATIENCE_S, ServedModule, check_errors, wrap_180

HEADING_DEG = 301.0

with ServedModule() as module:
    module.hold_heading(HEADING_DEG)
    command = ["node", Path(__file__).with_name("boat.js"), str(module.tcp)]
    read = subprocess.run(command, check=True, timeout=PATIENCE_S, stdout=subprocess.PIPE)
headings = json.loads(read.stdout)
mean_deg = check_errors([wrap_180(heading - HEADING_DEG) for kind in headings for heading in headings[kind]])
print(f"Signal K: {({kind: len(headings[kind]) for kind in headings})}, mean error {mean_deg:.1f} deg")
