"""A board's chip and another node of its CAN bus, for images that unicorn executes.

Registers are memory, except those of clock, timer and CAN controller, which are modelled after the reference manuals as far as the
programs use them. Interrupts are delivered while the program waits, one after the other. Time passes while the program waits, and
by a microsecond with each reading of the timer.
"""

import struct

from unicorn import UC_ARCH_ARM, UC_HOOK_CODE, UC_HOOK_MEM_INVALID, UC_HOOK_MEM_READ, UC_HOOK_MEM_WRITE, UC_MEM_READ
from unicorn import UC_MODE_MCLASS, UC_MODE_THUMB, Uc
from unicorn import arm_const as arm

FLASH, FLASH_SIZE, RETURN = 0x08000000, 1 << 20, 0x0F000000
MEMORY = [(0x10000000, 32 << 10), (0x20000000, 96 << 10), (0x1FFF7000, 0x1000), (RETURN, 0x1000)]
UNIQUE_ID = bytes(range(0x11, 0x1D))
WFE = b"\x20\xbf"

TIM15, TIM15_IRQ = 0x40014000, 24
TIM15_DIER, TIM15_SR, TIM15_CNT = TIM15 + 0xC, TIM15 + 0x10, TIM15 + 0x24
TIM15_COMPARES = [(1, TIM15 + 0x34), (2, TIM15 + 0x38)]
# A USART is ready and its line idle.
USART_STATUS = {at: 0x6000C0 for at in (0x4001381C, 0x4000441C, 0x40004C1C)}
ENABLE, PEND, CLEAR, PRIORITY = 0xE000E100, 0xE000E200, 0xE000E280, 0xE000E400
TRIGGER, CONTROL = 0xE000EF00, 0xE000ED0C
RESET_REQUEST = 0x05FA0004
NEVER_US = 1 << 60


class EmulatedChip:
    """Processor, memory, timer and interrupts. A board's chip adds its clock and its CAN controller."""

    def __init__(self, image, image_at, registers, node, errors_us=()):
        self.node, self.image_at, self.errors_us = node, image_at, list(errors_us)
        self.registers = registers | USART_STATUS
        self.now_us, self.timer_updated_us, self.until_us = 0, 0, 0
        self.enabled, self.pending, self.suspended = set(), set(), []
        self.received, self.sent, self.failure, self.is_reset = [], [], None, False
        cpu = self.cpu = Uc(UC_ARCH_ARM, UC_MODE_THUMB | UC_MODE_MCLASS)
        cpu.ctl_set_cpu_model(arm.UC_CPU_ARM_CORTEX_M4)
        cpu.mem_map(FLASH, FLASH_SIZE)
        cpu.mem_write(FLASH, b"\xff" * FLASH_SIZE)
        cpu.mem_write(image_at, image)
        for start, size in MEMORY:
            cpu.mem_map(start, size)
        cpu.mem_write(0x1FFF7590, UNIQUE_ID)
        cpu.mem_write(RETURN, b"\x00\xbf" * 4)
        for start, size in [(0x40000000, 0x10000000), (0x50000000, 0x1000), (0xE0000000, 0x100000)]:
            cpu.mem_map(start, size)
            cpu.hook_add(UC_HOOK_MEM_READ | UC_HOOK_MEM_WRITE, self.access, begin=start, end=start + size - 1)
        cpu.hook_add(UC_HOOK_MEM_INVALID, self.invalid)
        cpu.hook_add(UC_HOOK_CODE, self.finish_interrupt, begin=RETURN, end=RETURN)
        for at in range(0, len(image), 2):
            if image[at : at + 2] == WFE:
                cpu.hook_add(UC_HOOK_CODE, self.wait, begin=image_at + at, end=image_at + at)
        cpu.reg_write(arm.UC_ARM_REG_C1_C0_2, 0xF << 20)
        cpu.reg_write(arm.UC_ARM_REG_FPEXC, 1 << 30)
        self.stack, self.start = struct.unpack_from("<II", image)
        cpu.reg_write(arm.UC_ARM_REG_SP, self.stack)

    def read(self, at):
        """A register as the program reads it."""
        return self.registers.get(at, 0)

    def write(self, at, word):
        """Effect of a written register."""
        self.registers[at] = word

    def deliver(self, frame):
        """A frame arrives at the CAN controller."""
        raise NotImplementedError

    def detect_error(self):
        """The CAN controller detects an error of the bus."""
        raise NotImplementedError

    def run(self, until_us):
        """Runs until a time, a restart, or a fault."""
        self.until_us = until_us
        self.cpu.emu_start(self.start | 1, 0xFFFFFFFE)
        assert self.failure is None, self.failure

    def access(self, cpu, kind, address, size, value, _):
        at = address & ~3
        if kind == UC_MEM_READ:
            if at == TIM15_CNT:  # A program that polls it waits.
                self.now_us += 1
                word = self.now_us & 0xFFFF
            else:
                word = self.read(at)
            cpu.mem_write(at, struct.pack("<I", word))
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
        else:
            self.write(at, word)

    def fail(self, reason):
        self.failure = reason
        self.cpu.emu_stop()

    def transmit(self, number, data):
        """A frame of the program is on the bus."""
        self.sent.append((self.now_us, number, data))
        self.node.receive(self.now_us, number, data)

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
        return [(bit, (count - self.timer_updated_us - 1 & 0xFFFF) + 1) for bit, count in [(0, 0), *compares]]

    def update_timer(self):
        """Sets the flags of the time that has passed."""
        due = sum(1 << bit for bit, after_us in self.timer_events() if after_us <= self.now_us - self.timer_updated_us)
        self.timer_updated_us = self.now_us
        self.registers[TIM15_SR] = self.registers.get(TIM15_SR, 0) | due
        if due & self.registers.get(TIM15_DIER, 0):
            self.pending.add(TIM15_IRQ)

    def pass_time(self):
        timer_us = self.timer_updated_us + min(after_us for _, after_us in self.timer_events())
        error_us = self.errors_us[0] if self.errors_us else NEVER_US
        frame_us = self.node.next_frame_us()
        self.now_us = max(self.now_us, min(timer_us, error_us, frame_us))
        self.update_timer()
        if error_us <= self.now_us:
            self.errors_us.pop(0)
            self.detect_error()
        elif frame_us <= self.now_us:
            self.deliver(self.node.next_frame())

    def next_interrupt(self):
        ready = self.pending & self.enabled
        return min(ready, key=lambda number: (self.priority(number), number), default=None)

    def priority(self, number):
        return self.registers.get(PRIORITY + number & ~3, 0) >> 8 * (number & 3) & 0xFF

    def start_interrupt(self, number):
        self.pending.discard(number)
        (handler,) = struct.unpack("<I", self.cpu.mem_read(self.image_at + 64 + 4 * number, 4))
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
    """The other node, number 10: status, allocation of number 125, then requests, after the first frame of this number. Frames are facts of DroneCAN."""

    ALLOCATION, STATUS, STEP_US = 0x1E00010A, 0x1801550A, 300
    ALLOCATION_REPLIES = {
        "01111213141516": ["00111213141516c0"],
        "001718191a1b1c": ["91d3001112131481", "15161718191a1b21", "1c41"],
        "0000000000": ["0d70fa1112131482", "15161718191a1b22", "1c0000000042"],
    }

    def __init__(self, first_us, requests):
        self.requests = requests
        # The first frame has a length code above eight, which means eight bytes.
        status = bytes.fromhex("01000000000000c0")
        self.frames = [(first_us + 500_000 * i, (self.STATUS, status, 15 if i == 0 else 8)) for i in range(20)]
        self.has_asked = False

    def receive(self, now_us, number, data):
        if number & 0x7F == 0:
            self.queue(now_us, [(self.ALLOCATION, part) for part in self.ALLOCATION_REPLIES[data[:-1].hex()]])
        elif not self.has_asked:
            self.has_asked = True
            self.queue(now_us, self.requests)

    def queue(self, now_us, frames):
        for i, (number, data) in enumerate(frames, 1):
            data = bytes.fromhex(data)
            self.frames.append((now_us + i * self.STEP_US, (number, data, len(data))))
        self.frames.sort()

    def next_frame_us(self):
        return self.frames[0][0] if self.frames else NEVER_US

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
