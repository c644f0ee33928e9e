//! Register file of the RM3100.

pub(super) const READ_FLAG: u8 = 0x80;
const POLL_REGISTER: u8 = 0x00;
const CMM_REGISTER: u8 = 0x01;
const CCX1_REGISTER: u8 = 0x04;
const CCZ0_REGISTER: u8 = 0x09;
const TMRC_REGISTER: u8 = 0x0B;
const MX2_REGISTER: u8 = 0x24;
const MZ0_REGISTER: u8 = 0x2C;
const BIST_REGISTER: u8 = 0x33;
const STATUS_REGISTER: u8 = 0x34;
const HSHAKE_REGISTER: u8 = 0x35;
pub(super) const REVID_REGISTER: u8 = 0x36;

const REGISTER_COUNT: usize = 0x40;
/// Bit of `CMM` that starts the continuous mode.
const START_CONTINUOUS: u8 = 0x01;
/// Bits of `CMM` for data ready after a full sequence of axes.
const DRDM_SEQUENCE: u8 = 0b1000;
const DRDM: u8 = 0b1100;
const ALL_AXES: u8 = 0x70;
/// Bit of `BIST`: a self-test replaces the next single measurement.
const SELF_TEST_ENABLE: u8 = 0x80;
const DATA_READY: u8 = 0x80;

/// Time of a measurement of one axis per cycle count: 440 measurements per second at count 200 (manual, table 3-1).
const NANOSECONDS_PER_CYCLE: u64 = 11_364;

/// Duration of the self-test of three axes, microseconds, each with the longest timeout (manual, table 5-9).
const SELF_TEST_US: u64 = 3 * 120;

/// Period of the continuous mode at `TMRC` 0x92, microseconds; each higher value doubles it (manual, table 5-4).
const SHORTEST_PERIOD_US: u64 = 1_667;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum RunningMeasurement {
    SelfTest { ends_at_us: u64 },
    Field { ends_at_us: u64, is_continuous: bool },
}

/// Registers and the running measurement.
pub(super) struct Rm3100Registers {
    bytes: [u8; REGISTER_COUNT],
    running_measurement: Option<RunningMeasurement>,
}

impl Default for Rm3100Registers {
    /// Reset values of the manual's table 5-1.
    fn default() -> Self {
        let mut bytes = [0; REGISTER_COUNT];
        let cycle_counts = [CCX1_REGISTER + 1, CCX1_REGISTER + 3, CCX1_REGISTER + 5].map(|register| (register, 200));
        for (register, reset) in
            cycle_counts.into_iter().chain([(TMRC_REGISTER, 0x96), (HSHAKE_REGISTER, 0x1B), (REVID_REGISTER, 0x22)])
        {
            bytes[usize::from(register)] = reset;
        }
        Self { bytes, running_measurement: None }
    }
}

impl Rm3100Registers {
    pub fn register_value(&self, register: u8) -> u8 {
        self.bytes.get(usize::from(register)).copied().unwrap_or(0)
    }

    fn set_register(&mut self, register: u8, value: u8) {
        self.bytes[usize::from(register)] = value;
    }

    pub fn flip_register_bits(&mut self, register: u8, bits: u8) {
        self.set_register(register, self.register_value(register) ^ bits);
    }

    /// Reads a register, with the effects of the access.
    pub fn read_register(&mut self, register: u8) -> u8 {
        match register {
            CMM_REGISTER => self.stop_continuous_mode(),
            MX2_REGISTER..=MZ0_REGISTER => self.clear_data_ready(),
            _ => {}
        }
        self.register_value(register)
    }

    /// Writes a register, with the effects of the access.
    pub fn write_register(&mut self, register: u8, value: u8, now_us: u64, period_scale: f64) {
        self.clear_data_ready();
        match register {
            POLL_REGISTER => self.start_single(value, now_us),
            CMM_REGISTER => {
                self.set_register(CMM_REGISTER, value);
                self.running_measurement = self.is_continuous().then(|| RunningMeasurement::Field {
                    ends_at_us: now_us + self.period_us(period_scale),
                    is_continuous: true,
                });
            }
            TMRC_REGISTER => {
                self.stop_continuous_mode();
                self.set_register(TMRC_REGISTER, value);
            }
            CCX1_REGISTER..=CCZ0_REGISTER | BIST_REGISTER | HSHAKE_REGISTER => self.set_register(register, value),
            // Writes to read-only and alarm registers have no effect.
            _ => {}
        }
    }

    fn is_continuous(&self) -> bool {
        self.register_value(CMM_REGISTER) & (START_CONTINUOUS | ALL_AXES) == START_CONTINUOUS | ALL_AXES
    }

    fn stop_continuous_mode(&mut self) {
        self.set_register(CMM_REGISTER, self.register_value(CMM_REGISTER) & !START_CONTINUOUS);
        if matches!(self.running_measurement, Some(RunningMeasurement::Field { is_continuous: true, .. })) {
            self.running_measurement = None;
        }
    }

    /// Starts a single measurement; ignored in continuous mode or with fewer than three axes.
    fn start_single(&mut self, axes: u8, now_us: u64) {
        if self.is_continuous() || axes & ALL_AXES != ALL_AXES {
            return;
        }
        self.running_measurement = Some(if self.register_value(BIST_REGISTER) & SELF_TEST_ENABLE != 0 {
            RunningMeasurement::SelfTest { ends_at_us: now_us + SELF_TEST_US }
        } else {
            RunningMeasurement::Field { ends_at_us: now_us + self.sequence_duration_us(), is_continuous: false }
        });
    }

    /// Last measurement that has ended by the present time.
    pub fn take_ended_measurement(&mut self, now_us: u64, period_scale: f64) -> Option<RunningMeasurement> {
        match self.running_measurement? {
            RunningMeasurement::SelfTest { ends_at_us } | RunningMeasurement::Field { ends_at_us, .. }
                if ends_at_us > now_us =>
            {
                None
            }
            RunningMeasurement::Field { ends_at_us, is_continuous: true } => {
                let period_us = self.period_us(period_scale);
                let ended_at_us = now_us - (now_us - ends_at_us) % period_us;
                let next = |ends_at_us| RunningMeasurement::Field { ends_at_us, is_continuous: true };
                self.running_measurement = Some(next(ended_at_us + period_us));
                Some(next(ended_at_us))
            }
            single => {
                self.running_measurement = None;
                Some(single)
            }
        }
    }

    /// Data ready, unless continuous mode waits for an alarm.
    pub fn set_data_ready(&mut self) {
        if !self.is_continuous() || self.register_value(CMM_REGISTER) & DRDM == DRDM_SEQUENCE {
            self.set_register(STATUS_REGISTER, DATA_READY);
        }
    }

    fn clear_data_ready(&mut self) {
        self.set_register(STATUS_REGISTER, 0);
    }

    pub fn set_self_test_passed(&mut self, axis: usize, has_passed: bool) {
        let bit = 0x10 << axis;
        let other_bits = self.register_value(BIST_REGISTER) & !bit;
        self.set_register(BIST_REGISTER, if has_passed { other_bits | bit } else { other_bits });
    }

    pub fn set_measurement(&mut self, axis: usize, counts: i32) {
        let [_, high, middle, low] = counts.clamp(-0x80_0000, 0x7F_FFFF).to_be_bytes();
        for (register, byte) in (MX2_REGISTER + 3 * axis as u8..).zip([high, middle, low]) {
            self.set_register(register, byte);
        }
    }

    pub fn cycle_count(&self, axis: usize) -> u16 {
        let register = CCX1_REGISTER + 2 * axis as u8;
        u16::from_be_bytes([self.register_value(register), self.register_value(register + 1)])
    }

    /// Time of the measurement of an axis.
    pub fn axis_duration_us(&self, axis: usize) -> u64 {
        u64::from(self.cycle_count(axis)) * NANOSECONDS_PER_CYCLE / 1000
    }

    fn sequence_duration_us(&self) -> u64 {
        (0..3).map(|axis| self.axis_duration_us(axis)).sum()
    }

    /// Period of the continuous mode, microseconds; at least the duration of the measurement of three axes.
    fn period_us(&self, scale: f64) -> u64 {
        let doublings = u32::from((self.register_value(TMRC_REGISTER) & 0x0F).max(2)) - 2;
        let nominal_us = SHORTEST_PERIOD_US << doublings;
        ((nominal_us as f64 * scale).round() as u64).max(self.sequence_duration_us())
    }
}
