"""pydronecan as autopilot and tool on the module's CAN bus: allocates its number, reads field, status, description and counters,
lists and sets parameters, restarts the module, starts a firmware update, and allocates a number to a second module, to which
it is also a node with satellite navigation.

The output is docs/dronecan-session.txt: only values that are the same in every run.
"""

import math
import os

import dronecan
from dronecan import uavcan

from bus import BUS, TOOL_NODE, Bus
from served import ServedModule, check_errors, wrap_180

HEADING_DEG = 147.0
# Xi'an; WMM2025: 0.526 G in 2026.
TOTAL_GAUSS = 0.526
NAME = "org.autoswing.simulator"
SENDING_S = 4.0
# Status of a calibrated module with a heading: docs/dronecan.md.
CALIBRATED = 2 << 4 | 100 << 8

GetSet = uavcan.protocol.param.GetSet.Request
Value = uavcan.protocol.param.Value
Opcode = uavcan.protocol.param.ExecuteOpcode.Request
Restart = uavcan.protocol.RestartNode.Request
Update = uavcan.protocol.file.BeginFirmwareUpdate.Request


def show(title, message, *left_out):
    """Prints a message without the fields that differ in every run."""
    print(f"\n{title}")
    for line in dronecan.to_yaml(message).splitlines():
        line = line.split(" # [")[0].rstrip()
        if line.strip().split(":")[0] not in left_out:
            print(f"  {line}")


def text(value):
    """A parameter's value as text, whatever its type."""
    kind = dronecan.get_active_union_field(value)
    if kind == "empty":
        return ""
    return str(value.string_value) if kind == "string_value" else f"{getattr(value, kind):g}"


def show_parameters(parameters):
    print("\nGetSet, by index")
    print(f"  {'name':16}{'value':>10}{'default':>10}{'least':>10}{'most':>10}")
    for name, answer in parameters.items():
        values = answer.value, answer.default_value, answer.min_value, answer.max_value
        print(f"  {name:16}{''.join(f'{text(value):>10}' for value in values)}".rstrip())


def check_field(bus, wanted_hz):
    """Checks rate, strength and heading of the field messages of SENDING_S seconds."""
    bus.fields.clear()
    bus.spin(SENDING_S)
    readings = [event.message for event in bus.fields]
    assert all(reading.sensor_id == 0 and len(reading.magnetic_field_covariance) == 0 for reading in readings)
    fields = [tuple(reading.magnetic_field_ga) for reading in readings]
    errors = [wrap_180(math.degrees(math.atan2(-y, x)) - HEADING_DEG) for x, y, _ in fields]
    assert errors, "no fields"
    check_errors(errors)
    strength = sum(math.hypot(*field) for field in fields) / len(fields)
    assert abs(strength - TOTAL_GAUSS) < 0.02, strength
    rate_hz = len(fields) / SENDING_S
    assert abs(rate_hz / wanted_hz - 1.0) < 0.1, rate_hz
    print(f"\nMagneticFieldStrength2\n  {wanted_hz} a second, {strength:.1f} G, the heading is right")


def set_parameter(bus, number, name, typed, answered, **value):
    """Sets a parameter and prints the answer."""
    answer = text(bus.parameter(number, name=name, value=Value(**value)).value)
    print(f"\nGetSet {name} = {typed}\n  {answer}")
    assert answer == answered, answer


def request_restart(bus, number, request):
    """Sends a request that restarts the module; returns its answer when the module is back with the same number.

    Its counters show the restart: the simulator's clock goes on.
    """
    bus.spin(2.0)
    before = bus.request_response(uavcan.protocol.GetTransportStats.Request(), number).transfers_tx
    answer = bus.request_response(request, number)
    bus.spin(0.5)
    bus.status.clear()
    bus.spin_until(lambda: any(event.transfer.source_node_id == number for event in bus.status), "it does not come back")
    assert bus.request_response(uavcan.protocol.GetTransportStats.Request(), number).transfers_tx < before
    return answer


def broadcast_position_and_time(bus):
    """Broadcasts a position and a time, as a node with satellite navigation does five times a second."""
    fix = uavcan.equipment.gnss.Fix2(longitude_deg_1e8=854_000_000, latitude_deg_1e8=4_737_000_000)
    fix.gnss_timestamp.usec = 1_780_000_000_000_000
    fix.gnss_time_standard = fix.GNSS_TIME_STANDARD_UTC
    fix.status = fix.STATUS_3D_FIX
    for _ in range(15):
        bus.node.broadcast(fix)
        bus.spin(0.2)


with ServedModule("--can", BUS) as module:
    bus = Bus()
    module.hold_heading(HEADING_DEG)
    number = bus.module_node_number()
    print(f"$ lab serve --can {BUS}\n\nNode {TOOL_NODE}, with an allocator: pydronecan {dronecan.__version__}")
    print(f"\nAllocation\n  node {number}")

    def is_calibrated():
        return bus.status and bus.status[-1].message.vendor_specific_status_code == CALIBRATED

    bus.spin_until(is_calibrated, "no status of a calibrated module")
    assert all(event.message.health == 0 for event in bus.status if event.transfer.source_node_id == number)
    show("NodeStatus", bus.status[-1].message, "uptime_sec")

    info = bus.request_response(uavcan.protocol.GetNodeInfo.Request(), number)
    assert str(info.name) == NAME and info.hardware_version.major == 1, info
    show("GetNodeInfo", info, "status", "uptime_sec", "health", "mode", "sub_mode", "vendor_specific_status_code")
    stats = bus.request_response(uavcan.protocol.GetTransportStats.Request(), number)
    assert stats.transfers_tx > 0 and stats.can_iface_stats[0].frames_rx > 0, stats
    print("\nGetTransportStats\n  transfers and frames, sent and received")
    check_field(bus, 50)

    parameters = bus.parameters(number)
    assert len(parameters) == 25 and "CAN_NODE" in parameters, list(parameters)
    show_parameters(parameters)
    set_parameter(bus, number, "CAN_RATE", "20", "20", integer_value=20)
    check_field(bus, 20)
    set_parameter(bus, number, "CAN_RATE", "81", "20", integer_value=81)
    set_parameter(bus, number, "SIGNING", "open sesame", "on", string_value="open sesame")
    printed = module.type("status all", "saves: ")
    assert f"; node {number};" in printed and "signing: on" in printed, printed
    answer = bus.request_response(Opcode(opcode=Opcode().OPCODE_ERASE), number)
    show("ExecuteOpcode erase", answer)
    assert answer.ok
    for name, value in [("CAN_RATE", "50"), ("SIGNING", "off")]:
        answer = text(bus.parameter(number, name=name).value)
        print(f"\nGetSet {name}\n  {answer}")
        assert answer == value, answer

    answer = bus.request_response(Restart(magic_number=1), number)
    show("RestartNode, magic number 1", answer)
    assert not answer.ok
    answer = request_restart(bus, number, Restart(magic_number=Restart().MAGIC_NUMBER))
    show(f"RestartNode, magic number 0x{Restart().MAGIC_NUMBER:X}", answer)
    assert answer.ok
    path = uavcan.protocol.file.Path(path="a.bin")
    answer = request_restart(bus, number, Update(source_node_id=0, image_file_remote_path=path))
    show("BeginFirmwareUpdate a.bin", answer)
    assert answer.error == 0, answer
    bus.spin_until(lambda: "calibrated" in bus.texts, f"no text: {bus.texts}")
    print("\nLogMessage\n  calibrated")

    with ServedModule("--can", BUS, "--seed", "2", "--attitude", "peer", flash=os.environ["FLASH"] + ".second") as second:
        bus.fields.clear()
        bus.spin_until(lambda: len({event.transfer.source_node_id for event in bus.fields}) == 2, "no second compass")
        others = {event.transfer.source_node_id for event in bus.fields} - {number}
        print(f"\nAllocation to a second module\n  node {others.pop()}")
        broadcast_position_and_time(bus)
        for line in second.type("status all", "saves: ").splitlines():
            if line.startswith("field model: "):
                print(f"\nFix2; status all of the second module\n  {line}")
