"""CAN of the reference board's image: silent until the first frame, then a number by allocation, answers to requests, and counted
errors of the bus.

    reference_can.py IMAGE      autoswing.bin of scripts/build-firmware
"""

import struct
import sys

from emulated_chip import FLASH, UNIQUE_ID, EmulatedChip, Node, transfers

RCC, CAN1, GPIOB_PUPDR = 0x40021000, 0x40006400, 0x4800040C
CAN_MCR, CAN_MSR, CAN_TSR, CAN_RF0R, CAN_IER, CAN_ESR, CAN_BTR = (CAN1 + at for at in (0, 4, 8, 0xC, 0x14, 0x18, 0x1C))
CAN_FMR, CAN_FA1R, CAN_TX, CAN_RX = (CAN1 + at for at in (0x200, 0x21C, 0x180, 0x1B0))
CAN_TX_IRQ, CAN_RX_IRQ, CAN_SCE_IRQ = 19, 20, 22
SILENT, ERROR_FLAG, STUFF_ERROR = 1 << 31, 1 << 2, 1 << 4
# Enabled interrupts of errors: of the flag, of the code of the last error.
ERROR_INTERRUPTS = 1 << 15 | 1 << 11


class Chip(EmulatedChip):
    """STM32L475 (reference manual RM0351)."""

    def __init__(self, image, node, errors_us=()):
        registers = {RCC: 0x63, CAN_MCR: 0x10002, CAN_BTR: 0x01230000, CAN_FMR: 0x2A1C0E01}
        super().__init__(image, FLASH, registers, node, errors_us)
        self.can_mode = "sleep"

    def write(self, at, word):
        if at == CAN_RF0R:
            if word & 1 << 5 and self.received:
                self.received.pop(0)
        elif at == CAN_MSR:
            if word & ERROR_FLAG:
                self.registers[at] = 0
        elif at == CAN_TSR:
            pass
        elif at == CAN_BTR and self.can_mode != "initialisation":
            self.fail("CAN_BTR written outside initialisation mode")
        else:
            self.registers[at] = word
            if at == CAN_MCR:
                modes = {0: "normal", 1: "initialisation", 2: "sleep"}
                self.can_mode = modes.get(word & 3, "sleep")
            self.raise_errors()
            self.send()

    def read(self, at):
        value = self.registers.get(at, 0)
        if at == RCC:  # Oscillators that are on report that they are ready.
            return value & ~0x02000402 | (value & 1 << 8) << 2 | (value & 1) << 1 | (value & 1 << 24) << 1
        if at == RCC + 8:  # The status field shows the selected clock.
            return value & ~0xC | (value & 3) << 2
        if at in (RCC + 0x90, RCC + 0x94):
            return value & ~2 | (value & 1) << 1
        if at == CAN_MSR:
            return value | {"normal": 0, "initialisation": 1, "sleep": 2}[self.can_mode]
        if at == CAN_TSR:
            free = [box for box in range(3) if not self.registers.get(CAN_TX + 16 * box, 0) & 1]
            return (free[0] if free else 0) << 24 | sum(1 << 26 + box for box in free)
        if at == CAN_RF0R:
            return min(len(self.received), 3)
        if CAN_RX <= at < CAN_RX + 16 and self.received:
            number, data, length_code = self.received[0]
            words = struct.unpack("<II", data.ljust(8, b"\0"))
            return [number << 3 | 4, length_code, *words][(at - CAN_RX) // 4]
        return value

    def deliver(self, frame):
        if self.can_mode == "normal" and self.registers.get(CAN_FA1R, 0):
            self.received.append(frame)
            self.pending.add(CAN_RX_IRQ)

    def detect_error(self):
        self.registers[CAN_ESR] = STUFF_ERROR
        if self.registers[CAN_IER] & 1 << 11:
            self.registers[CAN_MSR] = ERROR_FLAG
        self.raise_errors()

    def raise_errors(self):
        if self.registers.get(CAN_MSR, 0) and self.registers.get(CAN_IER, 0) & ERROR_INTERRUPTS == ERROR_INTERRUPTS:
            self.pending.add(CAN_SCE_IRQ)

    def send(self):
        """Sends what is in the mailboxes."""
        for box in range(3):
            at = CAN_TX + 16 * box
            if self.registers.get(at, 0) & 1 and self.can_mode == "normal" and not self.registers[CAN_BTR] & SILENT:
                self.registers[at] &= ~1
                data = struct.pack("<II", self.registers[at + 8], self.registers[at + 12])
                self.pending.add(CAN_TX_IRQ)
                self.transmit(self.registers[at] >> 3, data[: self.registers[at + 4] & 15])


with open(sys.argv[1], "rb") as file:
    image = file.read()
FIRST_US = 1_000_000
chip = Chip(image, Node(2 * FIRST_US, []))
chip.run(FIRST_US)
assert chip.can_mode == "normal" and chip.registers[CAN_BTR] & SILENT, "not silent before the first frame"
# 20 quanta of 4 periods of 80 MHz: one before, 14, then 5; jumps by 4.
assert chip.registers[CAN_BTR] & ~SILENT == 3 << 24 | 4 << 20 | 13 << 16 | 3, f"timing {chip.registers[CAN_BTR]:#x}"
assert chip.registers[CAN_MCR] & (1 << 6 | 1 << 2) == 1 << 6 | 1 << 2, "no recovery from bus-off, or frames by priority"
assert chip.registers[GPIOB_PUPDR] >> 16 & 3 == 1, "no pull-up"
assert not chip.sent

requests = [(0x1E01FD8A, "c0"), (0x1E04FD8A, "c0"), (0x1E28FD8A, "00612e62696ec4"), (0x1E05FD8A, "1e1b55ceacc2")]
# The burst exceeds what is counted between two readings; the others do not.
burst_us, single_us = range(FIRST_US, FIRST_US + 6_000, 20), range(FIRST_US + 100_000, FIRST_US + 800_000, 100_000)
chip = Chip(image, Node(FIRST_US, requests), [*burst_us, *single_us])
chip.run(10_000_000)
assert not chip.registers[CAN_BTR] & SILENT, "silent after a frame"
assert chip.sent[0][0] > FIRST_US, "sent before the first frame"
answers = dict(transfers(chip.sent))
assert b"org.autoswing.b-l475e-iot01a" in answers[0x1E010AFD] and UNIQUE_ID in answers[0x1E010AFD], answers
errors = int.from_bytes(answers[0x1E040AFD][30:36], "little")
assert 255 + len(single_us) <= errors <= len(burst_us) + len(single_us), f"{errors} errors of the bus"
assert answers[0x1E280AFD][:1] == b"\xff", "a board without a boot loader accepts an update"
assert answers[0x1E050AFD] == b"\x80" and chip.is_reset, "no restart"
print(f"reference board: silent for {FIRST_US / 1e6:.0f} s without a frame, restarted on request at {chip.now_us / 1e6:.1f} s")
