"""Registers of the DroneCAN board's STM32G474 as ArduPilot's boot loader leaves them, and those that answer a request (reference manual
RM0440)."""

IMAGE_AT, UPDATE_SIZE = 0x08009000, 256
RCC_CR, RCC_CFGR, FLASH_OPTR = 0x40021000, 0x40021008, 0x40022020
CAN = 0x40006400
CREL, ENDN, CCCR = CAN, CAN + 4, CAN + 0x18
WATCHDOG_KEY, SYSTICK = 0x40003000, 0xE000E010
# Clock from the PLL, its oscillator and the crystal on, SysTick on.
AT_START = {RCC_CR: 1 << 24 | 1 << 16, RCC_CFGR: 3, FLASH_OPTR: 1 << 22, SYSTICK: 7, CREL: 0x32141218, ENDN: 0x87654321}


def answer(at, value):
    """A register's value as the program reads it back."""
    if at == RCC_CR:  # Oscillators that are on report that they are ready.
        value &= ~(1 << 10 | 1 << 17 | 1 << 25)
        value |= (value & 1 << 8) << 2 | (value & 1 << 16) << 1 | (value & 1 << 24) << 1
    elif at == RCC_CFGR:  # The status field shows the selected clock.
        value = value & ~0xC | (value & 3) << 2
    elif at == CCCR:  # A requested clock stop is acknowledged.
        value = value & ~(1 << 3) | (value & 1 << 4) >> 1
    return value
