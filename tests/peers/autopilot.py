"""The calibration flight of flight.py with pymavlink on the module's first port."""

# Imported before pymavlink, whose dialect this module sets.
from flight import ADDRESSES, fly
from pymavlink import mavutil

from served import ServedModule

with ServedModule("--attitude", "peer") as module:
    fly(module, mavutil.mavlink_connection(f"tcp:127.0.0.1:{module.autopilot_tcp}", **ADDRESSES))
    module.type("status all", "saves: ")
    assert " 0 rejected, 0 line errors" in module.printed, module.printed
    assert "found mavlink" in module.printed, module.printed
