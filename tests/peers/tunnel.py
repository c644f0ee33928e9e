"""The calibration flight of flight.py with pymavlink behind the autopilot's serial line on the CAN bus: a node of pydronecan
carries its bytes in tunnel.Targetted.
"""

import math

from dronecan import uavcan

# Imported before pymavlink, whose dialect this module sets.
from flight import ADDRESSES, fly
from pymavlink import mavutil

from bus import BUS, TOOL_NODE, Bus
from served import ServedModule, check_errors, wrap_180

SERIAL, BAUD = 0, 57600
Targetted = uavcan.tunnel.Targetted
MAVLINK2 = uavcan.tunnel.Protocol().MAVLINK2


class TunnelLink(mavutil.mavfile):
    """MAVLink connection through the bus, as ArduPilot maps a serial line."""

    def __init__(self, bus, module):
        super().__init__(None, f"node {module}", **ADDRESSES)
        self.bus, self.peer, self.received = bus, module, bytearray()
        bus.node.add_handler(Targetted, self.take)

    def take(self, event):
        message = event.message
        if event.transfer.source_node_id == self.peer and message.target_node == TOOL_NODE:
            assert (message.serial_id, message.protocol.protocol) == (SERIAL, MAVLINK2), message
            self.received += bytes(message.buffer)

    def recv(self, _=None):
        self.bus.node.spin(0)
        received, self.received = bytes(self.received), bytearray()
        return received

    def write(self, data):
        for at in range(0, len(data), 120):
            self.bus.node.broadcast(
                Targetted(
                    protocol=uavcan.tunnel.Protocol(protocol=MAVLINK2),
                    target_node=self.peer,
                    serial_id=SERIAL,
                    options=Targetted().OPTION_LOCK_PORT,
                    baudrate=BAUD,
                    buffer=list(data[at : at + 120]),
                )
            )


with ServedModule("--can", BUS, "--attitude", "peer") as module:
    bus = Bus()
    number = bus.module_node_number()
    flight = fly(module, TunnelLink(bus, number))
    bus.fields.clear()
    while len(bus.fields) < 100:
        flight.fly_period(0.0)
    errors = []
    for event in bus.fields:
        x, y, _ = event.message.magnetic_field_ga
        errors.append(wrap_180(math.degrees(math.atan2(-y, x)) - flight.aircraft.heading_deg))
    mean_deg = check_errors(errors)
    assert all(event.message.health == 0 for event in bus.status)
    print(f"tunnel: node {number}, headings of the field {mean_deg:.1f} deg off")
