"""pydronecan's node with an allocator on the module's CAN bus, as an autopilot and a tool have them."""

import time

import dronecan
from dronecan import uavcan

from served import PATIENCE_S

BUS = "mcast:9"
TOOL_NODE = 10


class Bus:
    """Node of the tool, and the messages received from the module."""

    def __init__(self):
        self.node = dronecan.make_node(BUS, node_id=TOOL_NODE, bitrate=1000000)
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

    def spin_until(self, condition, what):
        """Runs the bus until a condition holds; returns the time."""
        began = time.monotonic()
        while not condition():
            assert time.monotonic() - began < PATIENCE_S, what
            self.node.spin(0.01)
        return time.monotonic() - began

    def module_node_number(self):
        """Node number of the module, from its first field message."""
        self.spin_until(lambda: self.fields, "no field")
        return self.fields[0].transfer.source_node_id

    def request_response(self, request, number):
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
        return self.request_response(uavcan.protocol.param.GetSet.Request(**fields), number)

    def parameters(self, number):
        """All parameters by name, in the order of their index."""
        found = {}
        while True:
            answer = self.parameter(number, index=len(found))
            if not str(answer.name):
                return found
            found[str(answer.name)] = answer
