"""The DroneCAN board's image on a CAN bus: the mark of a good image after 30 s of work, a number by allocation, answers, and an update
that is handed over to the boot loader.

    holybro_can.py IMAGE      holybro-rm3100.bin of scripts/build-firmware
"""

import struct
import sys

from emulated_chip import UNIQUE_ID, EmulatedChip, Node, transfers
from stm32g474 import AT_START, CAN, CCCR, IMAGE_AT, UPDATE_SIZE, WATCHDOG_KEY, answer

UPDATE_AT, BACKUP = 0x20000000, 0x40002500
ECR, IR, RXF0S, RXF0A, TXBAR = (CAN + at for at in (0x40, 0x50, 0x90, 0x94, 0xCC))
TXFQS, CAN_IRQ = CAN + 0xC4, 21
# Elements of 72 bytes in the controller's memory.
RECEIVED_AT, SENT_AT, ELEMENT, EXTENDED = 0x4000A4B0, 0x4000A678, 72, 1 << 30
RESTRICTED, RECEIVED = 1 << 2, 1 << 0
GOOD_IMAGE, FETCH_UPDATE = 0xB0093A26, 0xB0080000


class Chip(EmulatedChip):
    """STM32G474 (reference manual RM0440)."""

    def __init__(self, image, node, errors_us=()):
        super().__init__(image, IMAGE_AT, AT_START, node, errors_us)
        self.first_received, self.fed_us, self.messages = 0, [], []

    def write(self, at, word):
        if at == RXF0A:
            self.received.pop(0)
            self.first_received = (self.first_received + 1) % 3
        elif at == IR:
            self.registers[IR] = self.registers.get(IR, 0) & ~word
        elif at == TXBAR:
            self.send(word)
        else:
            self.registers[at] = word
            if at == WATCHDOG_KEY and word == 0xAAAA:
                self.fed_us.append(self.now_us)
            if at == BACKUP:
                self.messages.append((self.now_us, word))

    def read(self, at):
        value = answer(at, self.registers.get(at, 0))
        if at == RXF0S:
            value = len(self.received) | self.first_received << 8
        elif at == TXFQS:
            value = 3
        elif at == ECR:  # Reading resets the counter.
            self.registers[at] = 0
        return value

    def deliver(self, frame):
        if self.registers[CCCR] & 1 or len(self.received) == 3:
            return
        number, data, length_code = frame
        at = RECEIVED_AT + ELEMENT * ((self.first_received + len(self.received)) % 3)
        words = number | EXTENDED, min(length_code, 8) << 16, *struct.unpack("<II", data.ljust(8, b"\0"))
        self.registers |= {at + 4 * i: word for i, word in enumerate(words)}
        self.received.append(frame)
        self.registers[IR] = self.registers.get(IR, 0) | RECEIVED
        self.pending.add(CAN_IRQ)

    def detect_error(self):
        self.registers[ECR] = min(self.registers.get(ECR, 0) + (1 << 16), 255 << 16)

    def send(self, requested):
        assert not self.registers[CCCR] & RESTRICTED, "sent in restricted operation mode"
        at = SENT_AT + ELEMENT * (requested.bit_length() - 1)
        number, length, *data = (self.registers.get(at + 4 * i, 0) for i in range(4))
        # Without its flag, which the program clears in a conditional block: unicorn does not leave one after a modelled register.
        self.pending.add(CAN_IRQ)
        self.transmit(number & ~EXTENDED, struct.pack("<II", *data)[: length >> 16 & 15])


with open(sys.argv[1], "rb") as file:
    image = file.read()

chip = Chip(image, Node(60_000_000, []))
chip.run(35_000_000)
assert chip.registers[CCCR] & RESTRICTED and not chip.sent, "not silent before the first frame"
waits_us = [after - before for before, after in zip(chip.fed_us, chip.fed_us[1:])]
assert max(waits_us) < 2_000_000, f"watchdog fed after {waits_us}"
[(good_us, message)] = chip.messages
assert message == GOOD_IMAGE and 30_000_000 <= good_us < 31_500_000, f"{message:#x} at {good_us / 1e6:.1f} s"
print(f"DroneCAN board: marked as good at {good_us / 1e6:.1f} s")

# Description, counters, an update.
FIRST_US, ERRORS = 31_000_000, 7
requests = [(0x1E01FD8A, "c0"), (0x1E04FD8A, "c0"), (0x1E28FD8A, "00612e62696ec4")]
for first_us in (1_000_000, FIRST_US):
    chip = Chip(image, Node(first_us, requests), range(first_us, first_us + ERRORS))
    chip.cpu.mem_write(UPDATE_AT, b"\xa5" * UPDATE_SIZE)
    chip.run(first_us + 10_000_000)
    assert not chip.registers[CCCR] & RESTRICTED and chip.sent[0][0] > first_us, "no end of silence"
    answers = dict(transfers(chip.sent))
    assert b"org.autoswing.holybro-rm3100" in answers[0x1E010AFD] and UNIQUE_ID in answers[0x1E010AFD], answers
    errors = int.from_bytes(answers[0x1E040AFD][30:36], "little")
    assert errors == ERRORS, f"{errors} errors of the bus"
    assert answers[0x1E280AFD] == b"\0" and chip.is_reset, "no update"
    expected = struct.pack("<I16xBB201sx", 0xC544AD9A, 10, 125, b"a.bin")
    assert bytes(chip.cpu.mem_read(UPDATE_AT, UPDATE_SIZE)) == expected + b"\xa5" * (UPDATE_SIZE - len(expected)), "update"
    assert chip.registers[BACKUP] == FETCH_UPDATE | 125, f"message to the boot loader {chip.registers[BACKUP]:#x}"
print(f"DroneCAN board: update handed over, restarted at {chip.now_us / 1e6:.1f} s")
