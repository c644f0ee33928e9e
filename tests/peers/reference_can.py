"""CAN of the reference board's image: silent until the first frame, then a number by allocation, and answers to requests.

unicorn executes the image's instructions. Registers are memory, except those of clock, timer and CAN controller, which are modelled
after the reference manual RM0351 as far as the program uses them. Interrupts are delivered while the program waits, one
after the other. Time passes while the program waits, and by a microsecond with each reading of the timer.

    reference_can.py IMAGE      autoswing.bin of scripts/build-firmware
"""

import struct
import sys

from unicorn import UC_ARCH_ARM, UC_HOOK_CODE, UC_HOOK_MEM_INVALID, UC_HOOK_MEM_READ, UC_HOOK_MEM_WRITE, UC_MEM_READ
from unicorn import UC_MODE_MCLASS, UC_MODE_THUMB, Uc
from unicorn import arm_const as arm

FLASH, FLASH_SIZE, RETURN = 0x08000000, 1 << 20, 0x0F000000
MEMORY = [(0x10000000, 32 << 10), (0x20000000, 96 << 10), (0x1FFF7000, 0x1000), (RETURN, 0x1000)]
UNIQUE_ID = bytes(range(0x11, 0x1D))
WFE = b"\x20\xbf"

TIM15, RCC, CAN1, GPIOB_PUPDR = 0x40014000, 0x40021000, 0x40006400, 0x4800040C
TIM15_DIER, TIM15_SR, TIM15_CNT = TIM15 + 0xC, TIM15 + 0x10, TIM15 + 0x24
TIM15_COMPARES = [(1, TIM15 + 0x34), (2, TIM15 + 0x38)]
CAN_MCR, CAN_MSR, CAN_TSR, CAN_RF0R, CAN_BTR, CAN_FMR, CAN_FA1R = (CAN1 + at for at in (0, 4, 8, 0xC, 0x1C, 0x200, 0x21C))
CAN_TX, CAN_RX = CAN1 + 0x180, CAN1 + 0x1B0
# A USART is ready and its line idle.
USART_STATUS = {at: 0x6000C0 for at in (0x4001381C, 0x4000441C, 0x40004C1C)}
ENABLE, PEND, CLEAR, PRIORITY = 0xE000E100, 0xE000E200, 0xE000E280, 0xE000E400
TRIGGER, CONTROL = 0xE000EF00, 0xE000ED0C
TIM15_IRQ, CAN_TX_IRQ, CAN_RX_IRQ = 24, 19, 20
SILENT = 1 << 31
RESET_REQUEST = 0x05FA0004


class Chip:
    """Processor, memory, and the registers that the program waits for."""

    def __init__(self, image, node):
        self.node = node
        self.registers = {RCC: 0x63, CAN_MCR: 0x10002, CAN_BTR: 0x01230000, CAN_FMR: 0x2A1C0E01} | USART_STATUS
        self.now_us, self.timed_us = 0, 0
        self.enabled, self.pending, self.suspended = set(), set(), []
        self.can_mode, self.received, self.sent, self.failure, self.is_reset = "sleep", [], [], None, False
        cpu = self.cpu = Uc(UC_ARCH_ARM, UC_MODE_THUMB | UC_MODE_MCLASS)
        cpu.ctl_set_cpu_model(arm.UC_CPU_ARM_CORTEX_M4)
        cpu.mem_map(FLASH, FLASH_SIZE)
        cpu.mem_write(FLASH, image.ljust(FLASH_SIZE, b"\xff"))
        for start, size in MEMORY:
            cpu.mem_map(start, size)
        cpu.mem_write(0x1FFF7590, UNIQUE_ID)
        cpu.mem_write(RETURN, b"\x00\xbf" * 4)
        for start, size in [(0x40000000, 0x10000000), (0xE0000000, 0x100000)]:
            cpu.mem_map(start, size)
            cpu.hook_add(UC_HOOK_MEM_READ | UC_HOOK_MEM_WRITE, self.access, begin=start, end=start + size - 1)
        cpu.hook_add(UC_HOOK_MEM_INVALID, self.invalid)
        cpu.hook_add(UC_HOOK_CODE, self.finish_interrupt, begin=RETURN, end=RETURN)
        for at in range(0, len(image), 2):
            if image[at : at + 2] == WFE:
                cpu.hook_add(UC_HOOK_CODE, self.wait, begin=FLASH + at, end=FLASH + at)
        cpu.reg_write(arm.UC_ARM_REG_C1_C0_2, 0xF << 20)
        cpu.reg_write(arm.UC_ARM_REG_FPEXC, 1 << 30)
        stack, self.start = struct.unpack_from("<II", image)
        cpu.reg_write(arm.UC_ARM_REG_SP, stack)

    def run(self, until_us):
        """Runs until a time, a restart, or a fault."""
        self.until_us = until_us
        self.cpu.emu_start(self.start | 1, 0xFFFFFFFE)
        assert self.failure is None, self.failure

    def access(self, cpu, kind, address, size, value, _):
        at = address & ~3
        if kind == UC_MEM_READ:
            cpu.mem_write(at, struct.pack("<I", self.value(at)))
            return
        word = self.registers.get(at, 0)
        shift, mask = 8 * (address & 3), (1 << 8 * size) - 1
        word = word & ~(mask << shift) | (value & mask) << shift
        if ENABLE <= at < ENABLE + 16:
            self.enabled |= {8 * (at - ENABLE) + bit for bit in range(32) if word >> bit & 1}
        elif PEND <= at < PEND + 16:
            self.pending |= {8 * (at - PEND) + bit for bit in range(32) if word >> bit & 1}
        elif CLEAR <= at < CLEAR + 16:
            self.pending -= {8 * (at - CLEAR) + bit for bit in range(32) if word >> bit & 1}
        elif at == TRIGGER:
            self.pending.add(word)
        elif at == CONTROL and word == RESET_REQUEST:
            self.is_reset = True
            cpu.emu_stop()
        elif at == TIM15_SR:
            self.registers[at] = self.registers.get(at, 0) & word
        elif at == CAN_RF0R:
            if word & 1 << 5 and self.received:
                self.received.pop(0)
        elif at == CAN_TSR:
            pass
        elif at == CAN_BTR and self.can_mode != "initialisation":
            self.failure = "CAN_BTR written outside initialisation mode"
            cpu.emu_stop()
        else:
            self.registers[at] = word
            if at == CAN_MCR:
                modes = {0: "normal", 1: "initialisation", 2: "sleep"}
                self.can_mode = modes.get(word & 3, "sleep")
            self.transmit()

    def value(self, at):
        """A register as the program reads it."""
        value = self.registers.get(at, 0)
        if at == TIM15_CNT:  # A program that polls it waits.
            self.now_us += 1
            return self.now_us & 0xFFFF
        if at == RCC:  # An oscillator that is on is ready.
            return value & ~0x02000402 | (value & 1 << 8) << 2 | (value & 1) << 1 | (value & 1 << 24) << 1
        if at == RCC + 8:  # The selected clock is in use.
            return value & ~0xC | (value & 3) << 2
        if at in (RCC + 0x90, RCC + 0x94):
            return value & ~2 | (value & 1) << 1
        if at == CAN_MSR:
            return {"normal": 0, "initialisation": 1, "sleep": 2}[self.can_mode]
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

    def transmit(self):
        """Sends what is in the mailboxes."""
        for box in range(3):
            at = CAN_TX + 16 * box
            if self.registers.get(at, 0) & 1 and self.can_mode == "normal" and not self.registers[CAN_BTR] & SILENT:
                self.registers[at] &= ~1
                data = struct.pack("<II", self.registers[at + 8], self.registers[at + 12])
                frame = self.registers[at] >> 3, data[: self.registers[at + 4] & 15]
                self.sent.append((self.now_us, *frame))
                self.pending.add(CAN_TX_IRQ)
                self.node.receive(self.now_us, *frame)

    def wait(self, cpu, address, _size, _):
        """The program waits: the next interrupt, or time passes until there is one."""
        cpu.reg_write(arm.UC_ARM_REG_PC, address + 2 | 1)
        self.update_timer()
        while (number := self.next_interrupt()) is None and self.now_us < self.until_us:
            self.pass_time()
        if number is None:
            cpu.emu_stop()
        else:
            self.suspended = cpu.context_save(), address + 2
            self.start_interrupt(number)

    def timer_events(self):
        """Timer's flags, with the times after the last update at which they are set."""
        compares = [(bit, self.registers.get(at, 0)) for bit, at in TIM15_COMPARES]
        return [(bit, (count - self.timed_us - 1 & 0xFFFF) + 1) for bit, count in [(0, 0), *compares]]

    def update_timer(self):
        """Sets the flags of the time that has passed."""
        due = sum(1 << bit for bit, after_us in self.timer_events() if after_us <= self.now_us - self.timed_us)
        self.timed_us = self.now_us
        self.registers[TIM15_SR] = self.registers.get(TIM15_SR, 0) | due
        if due & self.registers.get(TIM15_DIER, 0):
            self.pending.add(TIM15_IRQ)

    def pass_time(self):
        wait_us = min(after_us for _, after_us in self.timer_events())
        if (frame_us := self.node.next_frame_us() - self.now_us) <= wait_us:
            self.now_us += max(frame_us, 0)
            self.update_timer()
            if self.can_mode == "normal" and self.registers.get(CAN_FA1R, 0):
                self.received.append(self.node.next_frame())
                self.pending.add(CAN_RX_IRQ)
            return
        self.now_us += wait_us
        self.update_timer()

    def next_interrupt(self):
        ready = self.pending & self.enabled
        return min(ready, key=lambda number: (self.priority(number), number), default=None)

    def priority(self, number):
        return self.registers.get(PRIORITY + number & ~3, 0) >> 8 * (number & 3) & 0xFF

    def start_interrupt(self, number):
        self.pending.discard(number)
        (handler,) = struct.unpack("<I", self.cpu.mem_read(FLASH + 64 + 4 * number, 4))
        self.cpu.reg_write(arm.UC_ARM_REG_SP, self.cpu.reg_read(arm.UC_ARM_REG_SP) - 64 & ~7)
        self.cpu.reg_write(arm.UC_ARM_REG_LR, RETURN | 1)
        self.cpu.reg_write(arm.UC_ARM_REG_PC, handler | 1)

    def finish_interrupt(self, cpu, _address, _size, _):
        self.update_timer()
        context, place = self.suspended
        cpu.context_restore(context)
        cpu.reg_write(arm.UC_ARM_REG_PC, place | 1)
        if (number := self.next_interrupt()) is not None:
            self.start_interrupt(number)

    def invalid(self, cpu, _kind, address, _size, _value, _):
        self.failure = f"access to {address:#x} at {cpu.reg_read(arm.UC_ARM_REG_PC):#x}"
        return False


class Node:
    """The other node, number 10: status, allocation of number 125, then one request of each kind. Frames are facts of DroneCAN."""

    ALLOCATION, STATUS, STEP_US = 0x1E00010A, 0x1801550A, 300
    PARTS = {
        "01111213141516": ["00111213141516c0"],
        "001718191a1b1c": ["91d3001112131481", "15161718191a1b21", "1c41"],
        "0000000000": ["0d70fa1112131482", "15161718191a1b22", "1c0000000042"],
    }
    REQUESTS = [(0x1E01FD8A, "c0"), (0x1E28FD8A, "00612e62696ec4"), (0x1E05FD8A, "1e1b55ceacc2")]

    def __init__(self, first_us):
        # The first frame has a length code above eight, which means eight bytes.
        status = bytes.fromhex("01000000000000c0")
        self.frames = [(first_us + 500_000 * i, (self.STATUS, status, 15 if i == 0 else 8)) for i in range(20)]
        self.has_asked = False

    def receive(self, now_us, number, data):
        if number & 0x7F == 0:
            self.queue(now_us, [(self.ALLOCATION, part) for part in self.PARTS[data[:-1].hex()]])
        elif not self.has_asked:
            self.has_asked = True
            self.queue(now_us, self.REQUESTS)

    def queue(self, now_us, frames):
        for i, (number, data) in enumerate(frames, 1):
            data = bytes.fromhex(data)
            self.frames.append((now_us + i * self.STEP_US, (number, data, len(data))))
        self.frames.sort()

    def next_frame_us(self):
        return self.frames[0][0] if self.frames else 1 << 60

    def next_frame(self):
        return self.frames.pop(0)[1]


def transfers(frames):
    """Payloads of single frames and of transfers of several frames, by their identifiers, without the CRC."""
    parts = {}
    for _, number, data in frames:
        if data[-1] & 0x80:
            parts[number] = b""
        parts[number] += data[:-1]
        if data[-1] & 0x40:
            yield number, parts[number] if data[-1] & 0x80 else parts[number][2:]


with open(sys.argv[1], "rb") as file:
    image = file.read()
FIRST_US = 1_000_000
chip = Chip(image, Node(2 * FIRST_US))
chip.run(FIRST_US)
assert chip.can_mode == "normal" and chip.registers[CAN_BTR] & SILENT, "not silent before the first frame"
# 20 quanta of 4 periods of 80 MHz: one before, 14, then 5; jumps by 4.
assert chip.registers[CAN_BTR] & ~SILENT == 3 << 24 | 4 << 20 | 13 << 16 | 3, f"timing {chip.registers[CAN_BTR]:#x}"
assert chip.registers[CAN_MCR] & (1 << 6 | 1 << 2) == 1 << 6 | 1 << 2, "no recovery from bus-off, or frames by priority"
assert chip.registers[GPIOB_PUPDR] >> 16 & 3 == 1, "no pull-up"
assert not chip.sent

chip = Chip(image, Node(FIRST_US))
chip.run(10_000_000)
assert not chip.registers[CAN_BTR] & SILENT, "silent after a frame"
assert chip.sent[0][0] > FIRST_US, "sent before the first frame"
answers = dict(transfers(chip.sent))
assert b"org.autoswing.b-l475e-iot01a" in answers[0x1E010AFD] and UNIQUE_ID in answers[0x1E010AFD], answers
assert answers[0x1E280AFD][:1] == b"\xff", "a board without a boot loader accepts an update"
assert answers[0x1E050AFD] == b"\x80" and chip.is_reset, "no restart"
print(f"reference board: silent for {FIRST_US / 1e6:.0f} s without a frame, restarted on request at {chip.now_us / 1e6:.1f} s")
