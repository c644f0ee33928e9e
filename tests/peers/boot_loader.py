"""Start of the DroneCAN board's image from the state in which ArduPilot's boot loader leaves the chip.

unicorn executes the image's instructions; registers are memory, except those that the start waits for. Interrupts are not
delivered: the run ends when the program waits for the first one. The state is that of docs/dronecan.md, from the boot loader's sources:
its thread's stack in RAM that becomes variables, the clock from the PLL, interrupts pending and disabled, SysTick on.

    boot_loader.py IMAGE      holybro-rm3100.bin of scripts/build-firmware
"""

import struct
import sys

from unicorn import UC_ARCH_ARM, UC_HOOK_CODE, UC_HOOK_MEM_INVALID, UC_HOOK_MEM_READ, UC_HOOK_MEM_WRITE, UC_MEM_READ
from unicorn import UC_MODE_MCLASS, UC_MODE_THUMB, Uc
from unicorn import arm_const as arm

from stm32g474 import AT_START, CAN, CCCR, IMAGE_AT, RCC_CFGR, RCC_CR, SYSTICK, UPDATE_SIZE, WATCHDOG_KEY, answer

FLASH, FLASH_SIZE = 0x08000000, 512 * 1024
RAM, RAM_SIZE, STACK, STACK_SIZE = 0x20000000, 96 * 1024, 0x10000000, 32 * 1024
PERIPHERALS = [(0x40000000, 0x30000), (0x48000000, 0x2000), (0x50000000, 0x1000), (0xE0000000, 0x100000)]

RCC_AHB1RSTR, RCC_BDCR, FLASH_ACR, NBTP = 0x40021028, 0x40021090, 0x40022000, CAN + 0x1C
ENABLE, DISABLE, CLEAR = 0xE000E100, 0xE000E180, 0xE000E280
TIM2, FDCAN1 = 28, 21
HSI, PLL = 1, 3
WFE, WFI = b"\x20\xbf", b"\x30\xbf"


class Chip:
    """Processor, memory, and registers as the boot loader leaves them."""

    def __init__(self, image):
        self.registers = AT_START | {FLASH_ACR: 0x604}
        self.enabled = {TIM2, FDCAN1}
        self.writes = []
        self.fault = None
        self.instructions = 0
        cpu = self.cpu = Uc(UC_ARCH_ARM, UC_MODE_THUMB | UC_MODE_MCLASS)
        cpu.ctl_set_cpu_model(arm.UC_CPU_ARM_CORTEX_M4)
        cpu.mem_map(FLASH, FLASH_SIZE)
        cpu.mem_write(FLASH, b"\xff" * FLASH_SIZE)
        cpu.mem_write(IMAGE_AT, image)
        cpu.mem_map(RAM, RAM_SIZE)
        self.leftovers = bytes((7 * i + 3) % 256 for i in range(RAM_SIZE))
        cpu.mem_write(RAM, self.leftovers)
        cpu.mem_map(STACK, STACK_SIZE)
        cpu.mem_map(0x1FFF7000, 0x1000)
        for start, size in PERIPHERALS:
            cpu.mem_map(start, size)
            cpu.hook_add(UC_HOOK_MEM_READ | UC_HOOK_MEM_WRITE, self.access, begin=start, end=start + size - 1)
        cpu.hook_add(UC_HOOK_MEM_INVALID, self.invalid)
        cpu.hook_add(UC_HOOK_CODE, self.step, begin=FLASH, end=FLASH + FLASH_SIZE)

    def run(self, image, limit):
        stack, start = struct.unpack_from("<II", image)
        for register, value in [
            (arm.UC_ARM_REG_CONTROL, 2),
            (arm.UC_ARM_REG_PSP, RAM + 0x700),
            (arm.UC_ARM_REG_SP, RAM + 0x700),
            (arm.UC_ARM_REG_MSP, stack),
            (arm.UC_ARM_REG_PRIMASK, 1),
            (arm.UC_ARM_REG_BASEPRI, 0x30),
        ]:
            self.cpu.reg_write(register, value)
        self.cpu.emu_start(start | 1, 0xFFFFFFFE, count=limit)

    def register(self, number):
        return self.cpu.reg_read(number)

    def access(self, cpu, kind, address, size, value, _):
        at, shift = address & ~3, 8 * (address & 3)
        if kind == UC_MEM_READ:
            cpu.mem_write(at, struct.pack("<I", answer(at, self.registers.get(at, 0))))
            return
        mask = (1 << 8 * size) - 1
        word = self.registers.get(at, 0) & ~(mask << shift) | (value & mask) << shift
        self.writes.append((self.instructions, at, word))
        for start, change in [(ENABLE, self.enabled.update), (DISABLE, self.enabled.difference_update)]:
            if start <= at < start + 16:
                change({8 * (at - start) + bit for bit in range(32) if word >> bit & 1})
                return
        if at == RCC_AHB1RSTR and word & 1 << 8:
            assert self.registers[RCC_CFGR] & 3 == HSI, "wait states reset at 160 MHz"
        self.registers[at] = word

    def invalid(self, cpu, _kind, address, _size, _value, _):
        self.fault = f"access to {address:#x} at {cpu.reg_read(arm.UC_ARM_REG_PC):#x}"
        return False

    def step(self, cpu, address, _size, _):
        self.instructions += 1
        if bytes(cpu.mem_read(address, 2)) in (WFE, WFI):
            cpu.emu_stop()


with open(sys.argv[1], "rb") as file:
    image = file.read()
chip = Chip(image)
chip.run(image, limit=2_000_000)
assert chip.fault is None, chip.fault
place = chip.register(arm.UC_ARM_REG_PC)
assert bytes(chip.cpu.mem_read(place, 2)) in (WFE, WFI), f"no rest, but {place:#x} after {chip.instructions} instructions"
assert chip.register(arm.UC_ARM_REG_CONTROL) & 2 == 0, "on the boot loader's stack"
assert STACK < chip.register(arm.UC_ARM_REG_SP) <= STACK + STACK_SIZE, "stack"
assert (chip.register(arm.UC_ARM_REG_PRIMASK), chip.register(arm.UC_ARM_REG_BASEPRI)) == (0, 0), "interrupts disabled"
assert TIM2 not in chip.enabled and FDCAN1 in chip.enabled, f"enabled interrupts {chip.enabled}"
assert chip.registers[SYSTICK] & 3 == 0, "SysTick on"
assert any(at == CLEAR for _, at, _ in chip.writes), "pending interrupts stay"
assert bytes(chip.cpu.mem_read(RAM, UPDATE_SIZE)) == chip.leftovers[:UPDATE_SIZE], "update's memory written"
assert chip.registers[RCC_CFGR] & 3 == PLL and chip.registers[RCC_CR] & 1 << 16, "clock not from the crystal"
assert not any(at == RCC_BDCR and word & (1 << 16 | 3 << 8) for _, at, word in chip.writes), "backup domain reset"
# CAN controller as initialised: restricted operation; a bit has 10 quanta of 8 clock periods, sampled after the ninth quantum.
assert chip.registers[CCCR] & 0b111 == 0b100, f"CAN mode {chip.registers[CCCR]:#b}"
assert chip.registers[NBTP] == 0x70700, f"CAN timing {chip.registers[NBTP]:#x}"
fed = [after for after, at, word in chip.writes if at == WATCHDOG_KEY and word == 0xAAAA]
assert fed and fed[0] < 16_000, f"watchdog fed after {fed[:1]} instructions, not within 1 ms at 16 MHz"
print(f"boot loader: the image starts, feeds the watchdog after {fed[0]} instructions, rests after {chip.instructions}")
