"""pydronecan as autopilot and tool on the module's CAN bus: allocates its number, reads field, description and counters, lists
and sets parameters, restarts the module, and starts a firmware update.
"""

import math
import time

import dronecan
from dronecan import uavcan

from served import PATIENCE_S, Served, check_errors, wrap_180

BUS = "mcast:9"
HEADING_DEG = 147.0
# Xi'an; WMM2025: 0.526 G in 2026.
TOTAL_GAUSS = 0.526
NAME = "org.autoswing.simulator"


class Bus:
    """The tool's node, with an allocator."""

    def __init__(self):
        self.node = dronecan.make_node(BUS, node_id=10, bitrate=1000000)
        self.monitor = dronecan.app.node_monitor.NodeMonitor(self.node)
        self.allocator = dronecan.app.dynamic_node_id.CentralizedServer(self.node, self.monitor)
        self.fields, self.status, self.texts = [], [], []
        self.node.add_handler(uavcan.equipment.ahrs.MagneticFieldStrength2, lambda event: self.fields.append(event))
        self.node.add_handler(uavcan.protocol.NodeStatus, lambda event: self.status.append(event))
        self.node.add_handler(uavcan.protocol.debug.LogMessage, lambda event: self.texts.append(str(event.message.text)))

    def spin(self, seconds):
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            self.node.spin(0.01)

    def until(self, condition, what):
        """Runs the bus until a condition holds; returns the time."""
        began = time.monotonic()
        while not condition():
            assert time.monotonic() - began < PATIENCE_S, what
            self.node.spin(0.01)
        return time.monotonic() - began

    def ask(self, request, number):
        """Response to a request, repeated once a second."""
        answers = []
        for _ in range(10):
            self.node.request(request, number, lambda event: answers.append(event))
            self.spin(0.05)
            end = time.monotonic() + 1.0
            while not answers and time.monotonic() < end:
                self.node.spin(0.01)
            if answers and answers[0] is not None:
                return answers[0].response
            answers.clear()
        raise AssertionError(f"no answer to {request}")

    def parameter(self, number, **fields):
        return self.ask(uavcan.protocol.param.GetSet.Request(**fields), number)

    def parameters(self, number):
        """All parameters by name, in the order of their index."""
        found = {}
        while True:
            answer = self.parameter(number, index=len(found))
            if not str(answer.name):
                return found
            found[str(answer.name)] = answer


def integer(value):
    return uavcan.protocol.param.Value(integer_value=value)


def check_field(bus):
    bus.fields.clear()
    bus.spin(4.0)
    readings = [event.message for event in bus.fields]
    assert all(reading.sensor_id == 0 and len(reading.magnetic_field_covariance) == 0 for reading in readings)
    fields = [tuple(reading.magnetic_field_ga) for reading in readings]
    errors = [wrap_180(math.degrees(math.atan2(-y, x)) - HEADING_DEG) for x, y, _ in fields]
    assert errors, "no fields"
    mean_deg = check_errors(errors)
    strength = sum(math.hypot(*field) for field in fields) / len(fields)
    assert abs(strength - TOTAL_GAUSS) < 0.02, strength
    return len(fields) / 4.0, mean_deg


def restarted(bus, number, request):
    """Sends a request that restarts the module; returns its answer when the module is back with the same number.

    Its counters show the restart: the simulator's clock goes on.
    """
    bus.spin(2.0)
    before = bus.ask(uavcan.protocol.GetTransportStats.Request(), number).transfers_tx
    answer = bus.ask(request, number)
    bus.spin(0.5)
    bus.status.clear()
    bus.until(lambda: any(event.transfer.source_node_id == number for event in bus.status), "it does not come back")
    assert bus.ask(uavcan.protocol.GetTransportStats.Request(), number).transfers_tx < before
    return answer


with Served("--can", BUS) as module:
    bus = Bus()
    module.hold(HEADING_DEG)
    seconds = bus.until(lambda: bus.fields, "no field")
    number = bus.fields[0].transfer.source_node_id
    print(f"can: node {number} allocated, first field after {seconds:.1f} s")
    bus.until(lambda: bus.status, "no status")
    assert all(event.message.health == 0 for event in bus.status if event.transfer.source_node_id == number)

    info = bus.ask(uavcan.protocol.GetNodeInfo.Request(), number)
    assert str(info.name) == NAME and info.hardware_version.major == 1, info
    stats = bus.ask(uavcan.protocol.GetTransportStats.Request(), number)
    assert stats.transfers_tx > 0 and stats.can_iface_stats[0].frames_rx > 0, stats

    rate, error = check_field(bus)
    assert 45.0 < rate < 55.0, rate
    print(f"can: {rate:.0f} fields a second, mean error {error:.1f} deg")

    parameters = bus.parameters(number)
    assert len(parameters) == 22 and "CAN_NODE" in parameters, list(parameters)
    for name, answer in parameters.items():
        print(f"  {name:16}{dronecan.to_yaml(answer.value).strip():28}{dronecan.to_yaml(answer.default_value).strip()}")
    answer = bus.parameter(number, name="CAN_RATE", value=integer(20))
    assert answer.value.integer_value == 20, answer
    rate, _ = check_field(bus)
    assert 18.0 < rate < 22.0, rate
    answer = bus.parameter(number, name="CAN_RATE", value=integer(81))
    assert answer.value.integer_value == 20, answer
    answer = bus.parameter(number, name="SIGNING", value=uavcan.protocol.param.Value(string_value="open sesame"))
    assert str(answer.value.string_value) == "on", answer
    printed = module.type("status all", "saves: ")
    assert f"; node {number};" in printed and "signing: on" in printed, printed
    opcode = uavcan.protocol.param.ExecuteOpcode
    assert bus.ask(opcode.Request(opcode=opcode.Request().OPCODE_ERASE), number).ok
    assert bus.parameter(number, name="CAN_RATE").value.integer_value == 50
    assert str(bus.parameter(number, name="SIGNING").value.string_value) == "off"

    restart = uavcan.protocol.RestartNode.Request
    assert not bus.ask(restart(magic_number=1), number).ok
    assert restarted(bus, number, restart(magic_number=restart().MAGIC_NUMBER)).ok
    update = uavcan.protocol.file.BeginFirmwareUpdate
    path = uavcan.protocol.file.Path(path="a.bin")
    answer = restarted(bus, number, update.Request(source_node_id=0, image_file_remote_path=path))
    assert answer.error == 0, answer
    assert any("calibrated" in text for text in bus.texts), bus.texts
    print(f"can: listed and set parameters, restarted, began an update; texts: {bus.texts}")
