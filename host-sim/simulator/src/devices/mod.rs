//! Simulated hardware at register and wire level, with realistic timing on the simulation clock.
//!
//! Devices survive a reboot of the module: keep the handle outside the [`Simulation`](testkit::simulation::Simulation)
//! and give clones to its tasks.

pub mod can;
pub mod i2c;
pub mod lis3mdl;
pub mod nor_flash;
pub mod rm3100;
pub mod spi;
pub mod uart;

use autoswing::frames::{Field, Sensor};

/// Field in a magnetometer's axes as a function of simulation time in microseconds. The time is at most one measurement
/// period (1.6 s of a LIS3MDL) in the past.
pub type FieldSource = Box<dyn FnMut(u64) -> Field<Sensor>>;

/// Magnetometer of a module.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum SensorModel {
    /// ST LIS3MDL on I2C, the reference board's.
    #[default]
    Lis3mdl,
    /// PNI RM3100 on SPI.
    Rm3100,
}

impl SensorModel {
    /// All chips.
    pub const ALL: [Self; 2] = [Self::Lis3mdl, Self::Rm3100];

    /// Name on the command line.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Lis3mdl => "lis3mdl",
            Self::Rm3100 => "rm3100",
        }
    }

    /// Chip of a name.
    #[must_use]
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|model| model.name() == name)
    }
}
